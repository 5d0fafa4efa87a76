"""The bench of a bare rig: the board's line, the person at it, and how a step is made that needs both."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import math
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from ...board_protocol import (
    BoardState,
    BoardTime,
    ClearFault,
    ControllerRequest,
    LogRequest,
    RawVoltage,
    Stop,
    TimeRequest,
)
from ...board_values import BoardController, BoardLog, BoardStatus
from ...design.commissioning.findings import Diagnosis, Judgement, PlateDesign
from ...errors import DeviceError, HapticdError, UsageError
from ...io.devices.serial_link import SerialLink
from ...sim.plate.wirings import IDENTITY
from .. import glass
from ..firmware.conversation import Conversation, Link
from ..firmware.program import named_port
from .step import Outcome, Step, Verdict, add_config

if TYPE_CHECKING:
    from ...sim.bench import SimulatedBench

PRESS_S: Final = 60.0  # until a stop that was pressed counts as without effect
TOUCH_S: Final = 5.0  # to find the plate with a finger, and to rest there
EXTENDED_MS, EXTEND_EVERY_S = 400, 0.15  # of a voltage
STATUS_WITHIN_S: Final = 0.5
WRAP_US: Final = 1 << 32
SUPPLIES: Final = ("VDDA at the board's 3.3 V pin", "the +24 V rail", "the -24 V rail")
LATER: Final = "Stopped: `hapticd calibrate all` with the same --out goes on here."

_Result = TypeVar("_Result")


class BareRig(Conversation):
    """A conversation with the board of a rig, and measurements by the board's own tools."""

    async def design(self) -> PlateDesign:
        """Return what the board's firmware expects of its plate."""
        return PlateDesign.of(self.hello, await self.ask(ControllerRequest(), BoardController))

    async def status(self) -> BoardStatus:
        """Return the next status. Raises DeviceError."""
        found = await self.wait_for(BoardStatus, STATUS_WITHIN_S)
        if found is None:
            raise DeviceError("The board sends no status: reset it, and try again.")
        return found

    async def events(self) -> tuple[int, tuple[int, ...]]:
        """Return how many events the board has ever logged, and the codes of the newest, oldest first."""
        log = await self.ask(LogRequest(), BoardLog)
        return log.events, tuple(entry.code for entry in log.entries if entry.boot_id == self.hello.boot_id)

    @contextlib.asynccontextmanager
    async def raw(self, amplifier: int, volts: float) -> AsyncIterator[None]:
        """Context in which an amplifier has a voltage, until it ends by itself, a dead-man or a stop."""

        async def extend() -> None:
            while True:
                await asyncio.sleep(EXTEND_EVERY_S)
                self.send(RawVoltage(amplifier, complex(volts), EXTENDED_MS))

        with self.driving():
            await self.demand(RawVoltage(amplifier, complex(volts), EXTENDED_MS))
            extending = asyncio.get_running_loop().create_task(extend())
            try:
                yield
            finally:
                extending.cancel()
                self.send(Stop())

    async def drives(self) -> bool:
        """Return whether the board accepts a hundredth of a volt and keeps it."""
        await self.quiet()
        with self.driving():
            await self.demand(RawVoltage(0, 0.01 + 0j, EXTENDED_MS))
            states = [(await self.status()).state for _ in range(3)]
            self.send(Stop())
        return states[-1] is BoardState.TOOL

    async def quiet(self) -> None:
        """Wait until a tool has ramped down. What the board sent before, while a person typed, is dropped."""
        await self.ask(TimeRequest(0), BoardTime)
        for _ in range(10):
            if (await self.status()).state is not BoardState.TOOL:
                return


@dataclass(frozen=True, slots=True)
class Bench:
    """A rig: the person, a new line to its board, and the settings that name it. A stop has `press_s` to be pressed,
    a finger `touch_s` to land and rest."""

    person: Terminal | SimulatedBench
    new_link: Callable[[], Link]
    where: str
    out: Path
    device: dict[str, str | int]
    press_s: float = PRESS_S
    touch_s: float = TOUCH_S
    new_loop: Callable[[], asyncio.AbstractEventLoop] | None = None

    def run(self, what: Coroutine[Any, Any, _Result]) -> _Result:
        """Run a coroutine in the rig's time."""
        with asyncio.Runner(loop_factory=self.new_loop) as runner:
            return runner.run(what)

    @contextlib.asynccontextmanager
    async def board(self) -> AsyncIterator[BareRig]:
        """Context of a conversation with the board, whose fault is cleared: a step begins with a quiet plate."""
        async with BareRig(self.new_link(), self.where) as board:
            await board.ask(ClearFault(), BoardStatus)
            yield board


@contextlib.contextmanager
def at_bench(options: argparse.Namespace) -> Iterator[Bench]:
    """Context of the rig that the options name. Raises HapticdError."""
    if options.sim:
        from ...sim import bench
        from ...sim.plate.ground_truth import PlateSettings
        from ...sim.virtual_time import VirtualTimeLoop

        sim = glass.chosen(options)
        rig = bench.SimulatedBench(PlateSettings.of(sim.plate, sim.modes or None, sim.wiring))
        yield Bench(rig, rig.new_link, "the simulated rig", options.out, {}, 1.0, 0.5, VirtualTimeLoop)
        return
    with contextlib.ExitStack() as stack:
        port, baud = named_port(options, stack)
        where = f"{port} at {baud} baud"
        yield Bench(Terminal(), lambda: SerialLink(port, baud), where, options.out, {"port": port, "baud": baud})


class Terminal:
    """Asks at the terminal; an empty line is a reading that was not taken, q ends the calibration."""

    async def read_supply(self, place: int) -> float | None:
        return await _volts(f"{SUPPLIES[place]}, V")

    async def read_idle(self, sensor: int) -> float | None:
        return await _volts(f"DC at the ADC pin of sensor {sensor}, V")

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        where = f"peak at the output of amplifier {amplifier} ({asked_v:g} V is asked for), V"
        return await _volts(f"{where}; negative if it falls where the DAC's pin rises")

    async def pull_cable(self) -> None:
        tell("Pull the board's USB cable NOW.")

    async def plug_cable(self) -> None:
        await asyncio.to_thread(_line, "Plug the cable in again, then press Enter")

    async def push_stop(self, pushed: bool) -> None:
        if pushed:
            tell("Press the emergency stop NOW.")
        else:
            await asyncio.to_thread(_line, "Release the stop, then press Enter")

    async def touch_plate(self, touched: bool) -> None:
        tell("Rest a finger on the plate NOW." if touched else "Lift it.")

    def mend(self, findings: Sequence[Diagnosis]) -> bool:
        del findings
        _line("Mend it with the amplifiers' supply off, then press Enter to measure again (q: stop here)")
        return True


def tell(text: str) -> None:
    print(f"  {text}", flush=True)


async def _volts(what: str) -> float | None:
    """Ask until the answer is a number of volts, or none; meanwhile keep-alives go on. Raises HapticdError."""
    while True:
        text = await asyncio.to_thread(_line, f"{what} (Enter: not measured)")
        if not text:
            return None
        with contextlib.suppress(ValueError):
            if math.isfinite(value := float(text.replace(",", "."))):
                return value
        tell(f"{text[:40]!r} is no number of volts, such as 1.65.")


def _line(question: str) -> str:
    """Return the answer. Raises HapticdError for q, and at the input's end."""
    try:
        answer = input(f"  {question}: ").strip()
    except EOFError:
        raise HapticdError(LATER) from None
    if answer.lower() == "q":
        raise HapticdError(LATER)
    return answer


def add_board(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", help="serial port of the board, such as /dev/ttyACM0")
    parser.add_argument("--baud", type=int, help="its speed (default 921600)")


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises UsageError."""
    if options.wiring not in (None, IDENTITY):
        raise UsageError("--wiring: this step knows plates with an amplifier and a sensor for each mode only.")


def bench_step(
    name: str,
    order: int,
    summary: str,
    request: str,
    picture: str,
    measure: Callable[[Bench], Coroutine[Any, Any, Judgement]],
    *,
    back_to: str,
) -> Step:
    """Return a step of a bare rig, which shows what to do with a drawing, then measures and judges."""

    def run(options: argparse.Namespace) -> Verdict:
        print(f"\n{request}\n\n{picture}", flush=True)
        with at_bench(options) as bench:
            judgement = bench.run(measure(bench))
        width = max((len(what) for what, _ in judgement.figures), default=0)
        for what, value in judgement.figures:
            tell(f"{what:<{width}}  {value}")
        outcome = Outcome.PASS if judgement.is_passed else Outcome.FAIL
        return Verdict(name, outcome, judgement.sentence, (), {}, options.sim, judgement.findings)

    return Step(
        name=name,
        order=order,
        summary=f"{summary} (stop the service first)",
        example="--port /dev/ttyACM0 --out DIR",
        arguments=(add_board, add_config, glass.add_arguments),
        check=check,
        run=run,
        back_to=back_to,
        is_of_bare_rig=True,
    )
