"""The firmware's image in an emulator: its Cortex-M4 or M7 is Unicorn's, its peripherals are models.

`image` builds and reads the ELF, `cpu` runs it, `timing` counts its cycles, `chip` answers its registers by the tables
of `stm32f405`, `stm32g474` and `stm32h743`, `bench` closes the loop with a `plate` and a host. What runs is the program
that is flashed, to the last byte. What this leaves out: everything analogue but what the plates have, wait states and
bus contention, the pipeline beyond the manual's table.
"""
