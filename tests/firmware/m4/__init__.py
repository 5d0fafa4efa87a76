"""The firmware's Cortex-M4 image in an emulator: its processor is Unicorn's, its peripherals are models.

`image` builds and reads the ELF, `cpu` runs it, `timing` counts its cycles, `peripherals` answers its registers,
`wiring` derives what they mean, `stm32f405` and `stm32g474` hold a chip's manual for both, `boards` lists the boards,
`bench` closes the loop with a `plate` (`analog`: the independent one) and a host. What runs is the program that is
flashed, to the last byte.

What this leaves out: everything analogue but what the plates have, wait states and bus contention, the pipeline beyond
the manual's table.
"""
