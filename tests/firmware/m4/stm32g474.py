"""The STM32G474 as RM0440 (rev 9) has it: its memory map (2.2), its DMAMUX request inputs (13.3.2), the triggers of its
DACs and ADCs (22.7.1, 21.7.4), its clock tree (7.2); pins after the datasheet DS12288. A section's number at a block is
this manual's.
"""

from __future__ import annotations

from typing import ClassVar, Final

from . import peripherals
from .peripherals import Effect, Peripherals
from .wiring import INTERNAL_HZ, Lane, Sampling, Stream, Wiring

_ADC = {"ISR": 0x00, "CR": 0x08, "CFGR": 0x0C, "SMPR1": 0x14, "SMPR2": 0x18, "SQR1": 0x30, "DR": 0x40}
_CHANNEL = {"CR": 0x00, "NDTR": 0x04, "PAR": 0x08, "M0AR": 0x0C}
_RCC = {
    "CR": 0x00,
    "CFGR": 0x08,
    "PLLCFGR": 0x0C,
    "AHB2RSTR": 0x2C,
    "APB1RSTR1": 0x38,
    "AHB1ENR": 0x48,
    "AHB2ENR": 0x4C,
}
_LPUART = {"CR1": 0x00, "CR2": 0x04, "CR3": 0x08, "BRR": 0x0C, "ISR": 0x1C, "RDR": 0x24, "TDR": 0x28, "PRESC": 0x2C}
_REQUESTS: Final = {5: "ADC1", 6: "DAC1_1", 7: "DAC1_2", 34: "RX", 35: "TX", 36: "ADC2", 37: "ADC3", 38: "ADC4"} | {
    39: "ADC5",
    41: "DAC2_1",
    102: "DAC3_1",
    103: "DAC3_2",
}
_TRIGGER_TIM2_DAC: Final = 4
_TRIGGER_TIM2_ADC: Final = 11
_SAMPLE_CYCLES: Final = (2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5)
_CONVERSION_CYCLES: Final = 12.5
_INPUTS: Final = {("ADC1", 1): ("GPIOA", 0), ("ADC2", 2): ("GPIOA", 1), ("ADC3", 12): ("GPIOB", 0)} | {
    ("ADC4", 5): ("GPIOB", 15),
    ("ADC5", 2): ("GPIOA", 9),
}
# A mode's DAC: the register that its stream writes, its control register, the channel's first bit there, its pin.
_OUTPUTS: Final = {
    "DAC1_1": ("DAC1.DHR12R1", "DAC1", 0, ("GPIOA", 4)),
    "DAC1_2": ("DAC1.DHR12R2", "DAC1", 16, ("GPIOA", 5)),
    "DAC2_1": ("DAC2.DHR12R1", "DAC2", 0, ("GPIOA", 6)),
    "DAC3_2": ("DAC3.DHR12R2", "DAC3", 16, ("GPIOB", 1)),
    "DAC3_1": ("DAC3.DHR12R1", "DAC3", 0, ("GPIOB", 11)),
}
# The operational amplifier that a channel of DAC3 is VP_SEL 3 of.
_FOLLOWERS: Final = {"DAC3_2": "OPAMP.CSR3", "DAC3_1": "OPAMP.CSR6"}
_FOLLOWS: Final = 1 << 0 | 3 << 2 | 3 << 5 | 1 << 7  # on, VP_SEL, VM_SEL as follower, OPAHSM
# Clocks: DMA1, DMA2, DMAMUX; GPIOA to GPIOC, ADC12, ADC345, DAC1, DAC2; TIM2, TIM5, WWDG, PWR; LPUART1;
# SYSCFG and OPAMP.
_CLOCKED: Final = {"AHB1ENR": (0, 1, 2), "AHB2ENR": (0, 1, 2, 13, 14, 16, 17), "APB1ENR1": (0, 3, 11, 28)} | {
    "APB1ENR2": (0,),
    "APB2ENR": (0,),
}


class Registers(Peripherals):
    BLOCKS: ClassVar = {
        "PWR": (0x40007000, {"CR2": 0x04, "SR2": 0x14, "CR5": 0x80}),  # 6.4
        "LPUART1": (0x40008000, _LPUART),  # 41.7
        "SYSCFG": (0x40010000, {"EXTICR2": 0x0C}),  # 10.2.4
        "OPAMP": (0x40010300, {f"CSR{i}": 4 * (i - 1) for i in range(1, 7)}),  # 25.5
        "EXTI": (0x40010400, peripherals.EXTI),  # 15.5
        "DMA1": (0x40020000, {"ISR": 0x00, "IFCR": 0x04}),  # 12.6
        "DMA2": (0x40020400, {"ISR": 0x00, "IFCR": 0x04}),
        "DMAMUX": (0x40020800, {f"C{i}CR": 4 * i for i in range(16)}),  # 13.6
        "RCC": (0x40021000, _RCC | {"APB1ENR1": 0x58, "APB1ENR2": 0x5C, "APB2ENR": 0x60, "CSR": 0x94}),  # 7.4
        "FLASH": (0x40022000, {"ACR": 0x00, "OPTR": 0x20}),  # 3.7
        "GPIOA": (0x48000000, peripherals.GPIO),  # 9.4
        "GPIOB": (0x48000400, peripherals.GPIO),
        "GPIOC": (0x48000800, peripherals.GPIO),
        "ADC1": (0x50000000, _ADC),  # 21.7
        "ADC2": (0x50000100, _ADC),
        "ADC12": (0x50000300, {"CCR": 0x08}),  # 21.8
        "ADC3": (0x50000400, _ADC),
        "ADC4": (0x50000500, _ADC),
        "ADC5": (0x50000600, _ADC),
        "ADC345": (0x50000700, {"CCR": 0x08}),
        "DAC1": (0x50000800, peripherals.DAC),  # 22.7
        "DAC2": (0x50000C00, peripherals.DAC),
        "DAC3": (0x50001000, peripherals.DAC),
        **{
            f"DMA{unit}_C{i}": (0x40020000 + 0x400 * (unit - 1) + 0x08 + 0x14 * (i - 1), _CHANNEL)
            for unit in (1, 2)
            for i in range(1, 9)
        },
    }
    RESET: ClassVar = {"RCC.CR": 0x500, "RCC.CFGR": 0x5, "RCC.PLLCFGR": 0x1000, "RCC.AHB1ENR": 0x100} | {
        "PWR.CR5": 0x100,
        "GPIOA.MODER": 0xABFFFFFF,
        "GPIOB.MODER": 0xFFFFFEBF,
        "GPIOC.MODER": 0xFFFFFFFF,
        "GPIOC.IDR": 0,  # no amplifier has a fault, and the emergency stop is not pushed: both circuits are closed
        "LPUART1.ISR": 0xC0,  # nothing is on the line
        "FLASH.ACR": 0x40600,
        "FLASH.OPTR": 0xFFEFFCAA,  # as delivered, but for the brown-out level 4
        **{f"ADC{i}.{name}": value for i in range(1, 6) for name, value in (("CR", 1 << 29), ("CFGR", 1 << 31))},
    }
    POWER_ON: ClassVar = 0x0C000000  # there is no flag for power alone
    HSI_READY: ClassVar = 1 << 10
    PLL_FROM_CRYSTAL: ClassVar = (3, 3)
    FORGET_RESET_FLAGS: ClassVar = 1 << 23
    CHUNK_FLAGS: ClassVar = "DMA1.ISR"
    REFERENCE_WORD: ClassVar = 1654  # 1.212 V of 3.0
    REFERENCE_V: ClassVar = 3.0

    def was_read(self, name: str) -> None:
        """RM0440, 21.4.23: a read of the data clears EOC."""
        if name in ("ADC1.DR", "ADC5.DR"):
            self.registers[name.replace("DR", "ISR")] &= ~4

    def own_effects(self) -> dict[str, Effect]:
        converters = {13: ["ADC1", "ADC2", "ADC12"], 14: ["ADC3", "ADC4", "ADC5", "ADC345"]}
        converters |= {16: ["DAC1"], 17: ["DAC2"], 18: ["DAC3"]}
        return {
            "RCC.APB1RSTR1": lambda value: self.reset_blocks(value, {0: ["TIM2"]}),
            "RCC.AHB2RSTR": lambda value: self.reset_blocks(value, converters),
            "DMA1.IFCR": lambda value: self.clear("DMA1.ISR", value),
            "DMA2.IFCR": lambda value: self.clear("DMA2.ISR", value),
            **{f"ADC{i}.CR": self.adc_control(f"ADC{i}", 18, 0, self._convert_reference) for i in range(1, 6)},
        }

    def _convert_reference(self, name: str) -> None:
        """Once, by software: 4 us of sampling are needed (DS12288). RM0440, 21.4.11: channel 18 of each but ADC2."""
        assert name in ("ADC1", "ADC5")
        assert self.field("ADC12.CCR" if name == "ADC1" else "ADC345.CCR", 22, 1), "the reference is off"
        assert self.field(f"{name}.SMPR2", 24, 3) == 7, "640.5 cycles"
        assert self.field(f"{name}.CFGR", 10, 2) == 0, "started by a trigger"
        self.registers[f"{name}.DR"] = self.reference_reading()
        self.registers[f"{name}.ISR"] |= 4
        self.registers[f"{name}.CR"] &= ~4


class Wires(Wiring):
    CRYSTAL_HZ = 24e6

    def core_hz(self) -> float:
        p = self.p
        assert p.field("RCC.CFGR", 4, 4) < 8, "the AHB prescaler is 1"
        source = p.field("RCC.CFGR", 2, 2)
        if source != 3:
            return {1: INTERNAL_HZ, 2: self.CRYSTAL_HZ}[source]
        config = p["RCC.PLLCFGR"]
        assert config >> 24 & 1, "the PLL's output R is off"
        input_hz = self.CRYSTAL_HZ if config & 3 == 3 else INTERNAL_HZ
        phase_hz = input_hz / ((config >> 4 & 0xF) + 1)
        assert 2.66e6 <= phase_hz <= 16e6
        vco_hz = phase_hz * (config >> 8 & 0x7F)
        assert 96e6 <= vco_hz <= 344e6
        core_hz = vco_hz / (2 * (config >> 25 & 3) + 2)
        assert core_hz <= 150e6 or not p.field("PWR.CR5", 8, 1), "above 150 MHz without the boost mode"
        assert core_hz <= 34e6 * (1 + p.field("FLASH.ACR", 0, 4)), "too few wait states"
        return core_hz

    def timer_clock_hz(self) -> float:
        assert self.p.field("RCC.CFGR", 8, 6) == 0, "both APBs run at the core's clock"
        return self.core_hz()

    def streams(self) -> dict[str, Stream]:
        found = {}
        for unit in (1, 2):
            for i in range(1, 9):
                control = self.p[f"DMA{unit}_C{i}.CR"]
                if control & 1:
                    request = _REQUESTS[self.p[f"DMAMUX.C{8 * (unit - 1) + i - 1}CR"]]
                    assert request not in found, f"two streams answer {request}"
                    found[request] = self._stream(f"DMA{unit}_C{i}", control)
        return found

    def _stream(self, name: str, control: int) -> Stream:
        """RM0440, 12.6.3."""
        assert control >> 7 & 1, f"{name} stays at one address"
        assert not control >> 6 & 1, f"{name} walks through the peripherals"
        assert not control >> 14 & 1, f"{name} waits for no request"
        memory, items = self.p[f"{name}.M0AR"], self.p[f"{name}.NDTR"]
        assert 0x20000000 <= memory < 0x20018000, f"{name} cannot reach {memory:#x}"
        enabled = {"complete": 1, "half": 2, "error": 3}
        return Stream(
            name,
            self.p[f"{name}.PAR"],
            memory,
            items,
            1 << (control >> 10 & 3),
            1 << (control >> 8 & 3),
            bool(control >> 4 & 1),
            bool(control >> 5 & 1),
            frozenset(what for what, bit in enabled.items() if control >> bit & 1),
        )

    def sampling(self) -> Sampling:
        p = self.p
        clocked = all(p[f"RCC.{bus}"] >> bit & 1 for bus, bits in _CLOCKED.items() for bit in bits)
        assert clocked, "a peripheral runs without a clock"
        running = self.streams()
        channels = tuple(self._check_adc(f"ADC{k + 1}") for k in range(5) if f"ADC{k + 1}" in running)
        adcs = [running[f"ADC{k + 1}"] for k in range(len(channels))]
        dacs = [running[name] for name in list(_OUTPUTS)[: len(channels)]]
        for name, stream in zip(_OUTPUTS, dacs, strict=False):
            self._check_dac(name, stream)
        for k, stream in enumerate(adcs):
            assert stream.peripheral == p.ADDRESS[f"ADC{k + 1}.DR"]
            assert (stream.to_peripheral, stream.circular) == (False, True)
            assert (stream.memory_size, stream.peripheral_size) == (2, 4)
        self._check_order(adcs, dacs)
        last = int(adcs[-1].name[-1])
        return Sampling(
            self.timer_hz("TIM2"),
            adcs[0].items,
            self.trigger_delay_frac(),
            tuple(Lane(out.memory, back.memory, 2) for out, back in zip(dacs, adcs, strict=True)),
            channels,
            irq=10 + last,
            flags="DMA1.ISR",
            half=4 << 4 * (last - 1),
            complete=2 << 4 * (last - 1),
            sampling=tuple(stream.name for stream in adcs),
            playing=tuple(stream.name for stream in dacs),
        )

    def _check_order(self, adcs: list[Stream], dacs: list[Stream]) -> None:
        """The chunk's interrupt comes with the last word of an instant: the lowest priority of its controller (RM0440,
        12.4.4). Numbers of interrupts: 14.3."""
        assert len({stream.items for stream in adcs + dacs}) == 1
        names = [stream.name for stream in adcs]
        assert names == sorted(names)
        assert all(name.startswith("DMA1_") for name in names)
        assert len({self.p.field(f"{name}.CR", 12, 2) for name in names}) == 1
        assert [stream.interrupts for stream in adcs[:-1] + dacs] == [{"error"}] * (len(adcs + dacs) - 1)
        assert adcs[-1].interrupts == {"half", "complete", "error"}
        irqs = {10 + int(stream.name[-1]) for stream in adcs} | {55 + int(stream.name[-1]) for stream in dacs}
        assert self.interrupts() == irqs | {1, 23}, "the supply, the interlocks and the converters' streams"
        assert self.p["NVIC.IPR1"] == 0
        assert {self.p[f"NVIC.IPR{irq}"] for irq in irqs} == {0x10}
        has_tick = len(adcs) > 3
        assert self.p["NVIC.IPR23"] == (0x20 if has_tick else 0x10), "interlocks do not interrupt a tick"
        assert self.p["SCB.SHPR3"] == (0x20 << 16 if has_tick else 0), "PendSV is below the chunks (PM0214, 4.4.8)"

    def _check_dac(self, request: str, stream: Stream) -> None:
        """RM0440, 22.7.1 (CR) and 22.7.16 (MCR: HFSEL, MODE)."""
        register, block, first, (port, pin) = _OUTPUTS[request]
        assert stream.peripheral == self.p.ADDRESS[register]
        assert (stream.to_peripheral, stream.circular) == (True, True)
        assert (stream.memory_size, stream.peripheral_size) == (2, 4)
        assert self.p.field(f"{block}.CR", first, 1), "a DAC is off"
        assert self.p.field(f"{block}.CR", first + 1, 1), "a DAC is not triggered"
        assert self.p.field(f"{block}.CR", first + 2, 4) == _TRIGGER_TIM2_DAC
        assert self.p.field(f"{block}.CR", first + 12, 1), "a DAC does not ask for DMA"
        within = request in _FOLLOWERS
        modes = 3 | 3 << 16 if within else 0
        assert self.p[f"{block}.MCR"] == 2 << 14 | modes, (
            "an interface for 170 MHz; to the pins with the buffer, or within"
        )
        if within:
            assert self.p["RCC.AHB2ENR"] >> 18 & 1, "DAC3 runs without a clock"
            assert self.p[_FOLLOWERS[request]] == _FOLLOWS, "RM0440, 25.5.3 and 25.5.6"
        assert self.p.field(f"{port}.MODER", 2 * pin, 2) == 3, "an output is not analogue"

    def _check_adc(self, name: str) -> int:
        """RM0440, 21.7.3 (CR), 21.7.4 (CFGR), 21.7.6 and 21.7.7 (SMPR1, SMPR2), 21.7.11 (SQR1), 21.8.2 (CCR)."""
        p = self.p
        assert p[f"{name}.CR"] == 1 << 28 | 1 << 2 | 1, f"{name} does not convert"
        assert p.field(f"{name}.CFGR", 0, 2) == 3, "not circular by DMA"
        assert p.field(f"{name}.CFGR", 3, 2) == 0, "not 12 bits"
        assert (p.field(f"{name}.CFGR", 5, 5), p.field(f"{name}.CFGR", 10, 2)) == (_TRIGGER_TIM2_ADC, 2)
        assert not p.field(f"{name}.CFGR", 15, 1), f"{name} is not right-aligned"
        assert p.field(f"{name}.SQR1", 0, 4) == 0, f"{name} converts more than one channel"
        channel = p.field(f"{name}.SQR1", 6, 5)
        port, pin = _INPUTS[name, channel]
        assert p.field(f"{port}.MODER", 2 * pin, 2) == 3, "an input is not analogue"
        common = "ADC12" if name in ("ADC1", "ADC2") else "ADC345"
        watched = common == "ADC345" and bool(p["ADC5.CR"]) and p.field("ADC5.SQR1", 6, 5) == 18
        assert p[f"{common}.CCR"] == 3 << 16 | watched << 22, "independent, a quarter of the core's clock"
        clock_hz = self.core_hz() / 4
        assert clock_hz <= 52e6
        sample_cycles = _SAMPLE_CYCLES[p.field(f"{name}.SMPR{1 + channel // 10}", 3 * (channel % 10), 3)]
        half_s = (1 - self.trigger_delay_frac()) / self.timer_hz("TIM2")
        assert (sample_cycles + _CONVERSION_CYCLES) / clock_hz < half_s, "the DACs move while an ADC converts"
        return channel

    def window_watchdog_s(self) -> float:
        """RM0440, 36.5.2."""
        assert self.p.field("RCC.CFGR", 8, 3) < 4, "APB1 is divided"
        return self._window_watchdog_s(self.core_hz(), self.p.field("WWDG.CFR", 11, 3))

    def baud(self) -> float:
        p = self.p
        assert p["LPUART1.CR1"] == 0xD, "enabled, to send and to receive"
        assert (p.field("GPIOA.MODER", 4, 4), p.field("GPIOA.AFRL", 8, 8)) == (0xA, 0xCC), "PA2 and PA3 are AF12"
        return 256 * self.core_hz() / p["LPUART1.BRR"]

    def deaf(self) -> bool:
        """RM0440, 41.7.4: with OVRDIS an overrun loses its byte alone."""
        return bool(self.p.field("LPUART1.ISR", 3, 1)) and not self.p.field("LPUART1.CR3", 12, 1)

    def finish_sending(self) -> None:
        """RM0440, 12.6.3, EN: a channel that is not circular stays enabled, with nothing left."""
        self.p["DMA1_C8.NDTR"] = 0
        self.p["DMA1.ISR"] |= 2 << 28
