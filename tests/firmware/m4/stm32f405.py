"""The STM32F405 as RM0090 (rev 18) has it: its memory map (2.3), its DMA request tables 42 and 43 (10.3.3), the
triggers of its DAC (14.3.6) and ADCs (13.6), its clock tree (7.2). A section's number at a block is this manual's.
"""

from __future__ import annotations

from typing import ClassVar, Final

from . import peripherals
from .peripherals import Effect, Peripherals
from .wiring import INTERNAL_HZ, Lane, Sampling, Stream, Wiring, stream_of

_ADC = {"SR": 0x00, "CR1": 0x04, "CR2": 0x08, "SMPR1": 0x0C, "SMPR2": 0x10, "SQR1": 0x2C, "SQR3": 0x34, "DR": 0x4C}
_STREAM = {"CR": 0x00, "NDTR": 0x04, "PAR": 0x08, "M0AR": 0x0C, "FCR": 0x14}
_DMA = {"LISR": 0x00, "HISR": 0x04, "LIFCR": 0x08, "HIFCR": 0x0C}
_RCC = {"CR": 0x00, "PLLCFGR": 0x04, "CFGR": 0x08, "APB1RSTR": 0x20, "APB2RSTR": 0x24, "AHB1ENR": 0x30}
_REQUESTS: Final = {  # (unit, stream, channel) -> who asks
    (1, 5, 7): "DAC1",
    (1, 6, 7): "DAC2",
    (2, 0, 0): "ADC1",
    (2, 4, 0): "ADC1",
    (2, 2, 4): "RX",
    (2, 5, 4): "RX",
    (2, 7, 4): "TX",
}
_TRIGGER_TIM2_DAC: Final = 4
_TRIGGER_TIM2_ADC: Final = 6
_CONVERSION_CYCLES: Final = 3 + 12
# Clocks: TIM2, WWDG, DAC; USART1, ADC1, ADC2, SYSCFG.
_CLOCKED: Final = tuple(("APB1", bit) for bit in (0, 11, 29)) + tuple(("APB2", bit) for bit in (4, 8, 9, 14))


class Registers(Peripherals):
    BLOCKS: ClassVar = {
        "PWR": (0x40007000, {"CR": 0x00, "CSR": 0x04}),  # 5.4
        "DAC": (0x40007400, peripherals.DAC),  # 14.5
        "USART1": (0x40011000, {"SR": 0x00, "DR": 0x04, "BRR": 0x08, "CR1": 0x0C, "CR2": 0x10, "CR3": 0x14}),  # 30.6
        "ADC1": (0x40012000, _ADC),  # 13.13
        "ADC2": (0x40012100, _ADC),
        "ADC": (0x40012300, {"CCR": 0x04, "CDR": 0x08}),
        "SYSCFG": (0x40013800, {"EXTICR4": 0x14}),  # 9.2.6
        "EXTI": (0x40013C00, peripherals.EXTI),  # 12.3
        "GPIOA": (0x40020000, peripherals.GPIO),  # 8.4
        "GPIOB": (0x40020400, peripherals.GPIO),
        "RCC": (0x40023800, _RCC | {"APB1ENR": 0x40, "APB2ENR": 0x44, "CSR": 0x74}),  # 7.3
        "FLASH": (0x40023C00, {"ACR": 0x00, "OPTCR": 0x14}),  # 3.9
        "DMA1": (0x40026000, _DMA),  # 10.5
        "DMA2": (0x40026400, _DMA),
        **{
            f"DMA{unit}_S{i}": (0x40026000 + 0x400 * (unit - 1) + 0x10 + 0x18 * i, _STREAM)
            for unit in (1, 2)
            for i in range(8)
        },
    }
    RESET: ClassVar = {"RCC.CR": 0x83, "RCC.PLLCFGR": 0x24003010, "RCC.AHB1ENR": 0x00100000, "PWR.CR": 0x4000} | {
        "GPIOA.MODER": 0xA8000000,
        "GPIOB.MODER": 0x280,
        "GPIOB.IDR": 0,  # no amplifier has a fault, and the emergency stop is not pushed: both circuits are closed
        "USART1.SR": 0xC0,  # nothing is on the line
        "FLASH.OPTCR": 0x0FFFAAE1,  # as delivered, but for the brown-out level 3
    }
    HSI_READY: ClassVar = 1 << 1
    PLL_FROM_CRYSTAL: ClassVar = (1 << 22, 1 << 22)
    FORGET_RESET_FLAGS: ClassVar = 1 << 24
    CHUNK_FLAGS: ClassVar = "DMA2.LISR"
    REFERENCE_WORD: ClassVar = 1501  # 1.21 V of 3.3
    REFERENCE_V: ClassVar = 3.3
    _overrun_seen = False

    def was_read(self, name: str) -> None:
        """RM0090, 30.6.1: an overrun ends when SR was read while it stood, and DR after that."""
        if name == "USART1.SR":
            self._overrun_seen = bool(self.registers[name] & 1 << 3)
        elif name == "USART1.DR" and self._overrun_seen:
            self.registers["USART1.SR"] &= ~(1 << 3)
            self._overrun_seen = False
        elif name == "ADC1.DR":
            self.registers["ADC1.SR"] &= ~2

    def _convert(self, value: int) -> None:
        """RM0090, 13.13.3: SWSTART converts one channel; 13.13.16: TSVREFE connects the internal reference, which
        needs 10 us of sampling (DS8626)."""
        self.registers["ADC1.CR2"] = value & ~(1 << 30)
        if value & 1 << 30:
            assert value & 1, "started before it was switched on"
            assert self.registers["ADC1.SQR3"] == 17
            assert self.field("ADC.CCR", 23, 1), "the reference is not connected"
            assert self.field("ADC1.SMPR1", 21, 3) == 7, "480 cycles"
            self.registers["ADC1.DR"] = self.reference_reading()
            self.registers["ADC1.SR"] |= 2

    def own_effects(self) -> dict[str, Effect]:
        return {
            "RCC.APB1RSTR": lambda value: self.reset_blocks(value, {0: ["TIM2"], 29: ["DAC"]}),
            "RCC.APB2RSTR": lambda value: self.reset_blocks(value, {8: ["ADC1", "ADC2", "ADC"]}),
            "ADC1.CR2": self._convert,
            "DMA2.LIFCR": lambda value: self.clear("DMA2.LISR", value),
            "DMA2.HIFCR": lambda value: self.clear("DMA2.HISR", value),
            "DMA1.HIFCR": lambda value: self.clear("DMA1.HISR", value),
        }


def _divider(code: int) -> int:
    return 1 if code < 4 else 2 << (code - 4)


class Wires(Wiring):
    CRYSTAL_HZ = 8e6

    def core_hz(self) -> float:
        p = self.p
        assert p.field("RCC.CFGR", 4, 4) < 8, "the AHB prescaler is 1"
        source = p.field("RCC.CFGR", 2, 2)
        if source != 2:
            return (INTERNAL_HZ, self.CRYSTAL_HZ)[source]
        config = p["RCC.PLLCFGR"]
        input_hz = self.CRYSTAL_HZ if config >> 22 & 1 else INTERNAL_HZ
        return input_hz / (config & 0x3F) * (config >> 6 & 0x1FF) / (2 * (config >> 16 & 3) + 2)

    def apb_hz(self, bus: int) -> float:
        """RM0090, 7.3.3."""
        return self.core_hz() / _divider(self.p.field("RCC.CFGR", 10 if bus == 1 else 13, 3))

    def timer_clock_hz(self) -> float:
        """On APB1: twice the bus's clock if that is divided."""
        return self.apb_hz(1) * (2 if self.p.field("RCC.CFGR", 10, 3) >= 4 else 1)

    def streams(self) -> dict[str, Stream]:
        found = {}
        for unit in (1, 2):
            for i in range(8):
                name = f"DMA{unit}_S{i}"
                control = self.p[f"{name}.CR"]
                if control & 1:
                    assert self.p["RCC.AHB1ENR"] >> (20 + unit) & 1, f"{name} runs without a clock"
                    request = _REQUESTS[unit, i, control >> 25 & 7]
                    assert request not in found, f"two streams answer {request}"
                    found[request] = self._stream(name, control)
        return found

    def _stream(self, name: str, control: int) -> Stream:
        memory = self.p[f"{name}.M0AR"]
        assert 0x20000000 <= memory < 0x20020000, f"{name} cannot reach {memory:#x}"
        return stream_of(name, control, self.p[f"{name}.PAR"], memory, self.p[f"{name}.NDTR"])

    def sampling(self) -> Sampling:
        p = self.p
        assert all(p[f"RCC.{bus}ENR"] >> bit & 1 for bus, bit in _CLOCKED), "a peripheral runs without a clock"
        self._check_dacs()
        channels = self._check_adcs()
        running = self.streams()
        out, back = running["DAC1"], running["ADC1"]
        assert "DAC2" not in running, "one stream feeds both DACs"
        assert (out.peripheral, back.peripheral) == (p.ADDRESS["DAC.DHR12RD"], p.ADDRESS["ADC.CDR"])
        assert (out.to_peripheral, out.circular, out.memory_size, out.peripheral_size) == (True, True, 4, 4)
        assert (back.to_peripheral, back.circular, back.memory_size, back.peripheral_size) == (False, True, 4, 4)
        assert out.items == back.items
        assert (out.interrupts, back.interrupts) == ({"error"}, {"half", "complete", "error"})
        assert self.interrupts() == {1, 16, 40, 56}, "the supply, the DACs' stream, the interlocks, the ADCs' stream"
        assert [p[f"NVIC.IPR{irq}"] for irq in (1, 16, 40, 56)] == [0, 0x10, 0x10, 0x10]
        return Sampling(
            self.timer_hz("TIM2"),
            out.items,
            self.trigger_delay_frac(),
            tuple(Lane(out.memory + 2 * k, back.memory + 2 * k, 4) for k in range(2)),
            channels,
            irq=56,
            flags="DMA2.LISR",
            half=0x10,
            complete=0x20,
            sampling=("DMA2_S0",),
            playing=("DMA1_S5",),
        )

    def _check_dacs(self) -> None:
        """RM0090, 14.5.1: EN, TEN, TSEL, DMAEN; 14.3.6: TIM2's trigger."""
        for channel in (0, 16):
            assert self.p.field("DAC.CR", channel, 1), "a DAC is off"
            assert self.p.field("DAC.CR", channel + 2, 1), "a DAC is not triggered"
            assert self.p.field("DAC.CR", channel + 3, 3) == _TRIGGER_TIM2_DAC
        assert self.p.field("DAC.CR", 12, 1), "DAC channel 1 does not ask for DMA"
        assert not self.p.field("DAC.CR", 28, 1), "channel 2's requests would go nowhere and count as underruns"
        assert self.p.field("GPIOA.MODER", 8, 4) == 0xF, "PA4 and PA5 are not analogue"

    def _check_adcs(self) -> tuple[int, ...]:
        """RM0090, 13.13.3 (CR2), 13.13.5 (SMPR2), 13.13.9 and 13.13.11 (SQR1, SQR3), 13.13.16 (CCR)."""
        p = self.p
        assert p.field("ADC.CCR", 0, 5) == 6, "not dual simultaneous"
        assert p.field("ADC.CCR", 14, 2) == 2, "not pairs by DMA"
        assert p.field("ADC.CCR", 13, 1), "requests end with the buffer's first round"
        for name in ("ADC1", "ADC2"):
            assert p.field(f"{name}.CR2", 0, 1), f"{name} is off"
            assert not p.field(f"{name}.CR2", 11, 1), f"{name} is not right-aligned"
            assert p.field(f"{name}.SQR1", 20, 4) == 0, f"{name} converts more than one channel"
            assert p[f"{name}.SMPR2"] == 0, f"{name} samples for more than 3 cycles"
        assert p.field("ADC1.CR2", 24, 4) == _TRIGGER_TIM2_ADC
        assert (p.field("ADC1.CR2", 28, 2), p.field("ADC2.CR2", 28, 2)) == (2, 0), "the falling edge; ADC2 follows"
        clock_hz = self.apb_hz(2) / (2 * p.field("ADC.CCR", 16, 2) + 2)
        assert clock_hz <= 36e6
        assert _CONVERSION_CYCLES / clock_hz < 1 / self.timer_hz("TIM2"), "a conversion outlasts the period"
        channels = p["ADC1.SQR3"] & 0x1F, p["ADC2.SQR3"] & 0x1F
        assert all(p.field("GPIOA.MODER", 2 * pin, 2) == 3 for pin in channels), "an input is not analogue"
        return channels

    def window_watchdog_s(self) -> float:
        """RM0090, 22.6.2."""
        return self._window_watchdog_s(self.apb_hz(1), self.p.field("WWDG.CFR", 7, 2))

    def baud(self) -> float:
        """RM0090, 30.6.3."""
        return self.apb_hz(2) / self.p["USART1.BRR"]

    def deaf(self) -> bool:
        return bool(self.p.field("USART1.SR", 3, 1))

    def finish_sending(self) -> None:
        """RM0090, 10.5.5, EN: a stream that is not circular disables itself."""
        self.p["DMA2_S7.CR"] &= ~1
        self.p["DMA2.HISR"] |= 1 << 27
