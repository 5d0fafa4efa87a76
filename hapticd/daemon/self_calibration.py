"""Calibration while the plate is touched: the rim between the daemon's loop and the process that fits.

What the machine's observer is given goes to the process through a pipe, after the event in which it happened; a pipe
that is full loses records, never time. A verdict comes back as a line. A pad is adopted in small steps (`adoption`),
map, sensors, a finger's load and the contacts' sizes while no finger is down; each is an input of the machine. What is
adopted is at first half of what was found, and is taken back if later touches speak against it. If the process ends,
nothing more is adopted.
"""

from __future__ import annotations

import asyncio
import logging
import os
import subprocess
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple
from typing import Any

import msgpack

from ..config.sections import Config
from ..core.plate.mode_shapes import ModeShapes
from ..core.plate.parasitic_modes import ParasiticModes
from ..files.recording.header import Header, header_fields
from ..files.recording.kinds import Fields, record_of
from .adoption import Adoption, Evidence, PlateChange, Trust, Unknown, configured_pad, is_load_near
from .contact_sizes import SizesAdoption
from .machine import Machine
from .proposal import Proposal, proposal_of

log = logging.getLogger("hapticd")

MOST_WAITING_BYTES = 1 << 20  # for the pipe: some 7 s of touching
STEP_EVERY_NS = 10_000_000
_LONGEST_LINE_BYTES = 1 << 21  # the largest map is a megabyte
_PIECE_BYTES = 1 << 16
_PASS_FIELDS = ("age_ns", "fingers", "t_apply_ns")
# Few, and never lost: all that follows is judged by them.
IN_FORCE = ("adopt", "adopt_readings", "adopt_map", "adopt_load")
KINDS = ("board_bytes", "written", "pass", *IN_FORCE)
_TAKEN_BACK = "The sensors show that what was adopted is worse than what is configured: it is taken back."
_FAR = "far from the configured one: run hapticd calibrate"


class SelfCalibration:
    """Feeds the process, and adopts what it finds."""

    def __init__(self, config: Config, scanned: ModeShapes, parasitic_modes: ParasiticModes | None) -> None:
        """`scanned` is the map from which the plate may not be far, nor a finger's load from that of these modes."""
        self._adoption = Adoption.of(configured_pad(config))
        self._trust = Trust()
        self._scanned = scanned
        self._uncertainty = config.uncertainty
        self._unknown = Unknown.configured(config.uncertainty)  # in force
        self._parasitic_modes = parasitic_modes
        self._change: PlateChange | None = None  # the last that was found
        self._is_due = False  # it waits for the fingers to lift
        self._load_1_s: complex | None = None  # the last that was found
        self._is_load_due = False
        self._sizes = SizesAdoption(config)
        self._waiting: deque[tuple[str, int, Sequence[Any]]] = deque()
        self.process: subprocess.Popen[bytes] | None = None
        self._out = bytearray()
        self._line = b""
        self._has_gap = False
        self._t_stepped_ns = 0
        self._verdicts = self._adopted = self._dropped = self._steps = self._maps = self._loads = 0
        self._taken_back = 0
        self._last = self._last_of_map = ""
        self._next_place: tuple[int, int] | None = None
        self._map_sigma: tuple[tuple[float, ...], ...] | None = None  # of the last map that was found
        self._map_known = ""

    def start(self, loop: asyncio.AbstractEventLoop, command: Sequence[str], header: Header) -> None:
        """Start the process that `command` names; one that cannot be started is a warning."""
        self._loop = loop
        try:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except OSError as error:
            log.warning("the self-calibration cannot start, the pad stays as it is: %s", error.strerror)
            return
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            os.set_blocking(pipe.fileno(), False)
        loop.add_reader(self.process.stdout, self._read)  # type: ignore[arg-type]
        self._send(header_fields(header))

    def _read(self) -> None:
        assert self.process is not None
        assert self.process.stdout is not None
        try:
            data = os.read(self.process.stdout.fileno(), _PIECE_BYTES)
        except BlockingIOError:
            return
        *lines, self._line = (self._line + data).split(b"\n")
        for line in lines:
            if not self.take_verdict(line):
                return
        if not data:
            self._lost()
        elif len(self._line) > _LONGEST_LINE_BYTES:
            self._refuse(self._line)

    def _lost(self) -> None:
        log.warning("the self-calibration's process has ended: the pad stays as it is")
        self.close()

    def _refuse(self, line: bytes) -> None:
        log.warning("the self-calibration's process sent no verdict, the pad stays as it is: %r", line[:80])
        self.close()

    def _write(self) -> None:
        """Write what the pipe takes, and the rest when it takes more."""
        if self.process is None or self.process.stdin is None:
            return
        pipe = self.process.stdin.fileno()
        try:
            while self._out:
                del self._out[: os.write(pipe, self._out[:_PIECE_BYTES])]
        except BlockingIOError:
            self._loop.add_writer(pipe, self._write)
            return
        except OSError:  # it reads no more
            self._lost()
            return
        self._loop.remove_writer(pipe)

    def put(self, kind: str, t_ns: int, *values: Any) -> None:
        """A machine's observer: encoded when the loop comes back from this event, so that no pass waits for it."""
        if self.process is None or kind not in KINDS:
            return
        if not self._waiting:
            self._loop.call_soon(self._flush)
        self._waiting.append((kind, t_ns, values))

    def _flush(self) -> None:
        while self._waiting:
            kind, t_ns, values = self._waiting.popleft()
            self._send([kind, t_ns, _fields(kind, t_ns, values)], must_arrive=kind in IN_FORCE)

    def _send(self, message: object, *, must_arrive: bool = False) -> None:
        if self.process is None:
            return
        if len(self._out) > MOST_WAITING_BYTES and not must_arrive:
            self._dropped += 1
            self._has_gap = True
            return
        if self._has_gap:
            self._has_gap = False
            self._out += msgpack.packb(None)
        was_waiting = len(self._out) > 0
        self._out += msgpack.packb(message)
        if not was_waiting:
            self._write()

    def restart(self) -> None:
        """Another machine begins: what was seen of the one before does not belong to it. The pad stays where it is."""
        self._has_gap = True

    def take_verdict(self, line: bytes) -> bool:
        """Take one line of the process; one that is no verdict ends the process, and False is returned."""
        try:
            proposal = proposal_of(line)
            said = self._request(proposal)
            if proposal.refusal is not None or said:
                self._last = said
            if proposal.refusal is not None:
                self._verdicts += 1
                self._last_of_map, self._next_place = proposal.map_refusal, proposal.next_place
            if proposal.map_sigma is not None:
                self._map_sigma, self._map_known = proposal.map_sigma, proposal.map_known
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            self._refuse(line)
            return False
        return True

    def _request(self, verdict: Proposal) -> str:
        """Begin to adopt what was found, while nothing else is adopted; returns why it, or the load, is refused."""
        refusal, correction, change = verdict.refusal or "", verdict.correction, verdict.change
        far = ""
        if verdict.load_1_s is not None:
            if is_load_near(verdict.load_1_s, self._parasitic_modes):
                self._load_1_s, self._is_load_due = verdict.load_1_s, True
            else:
                far = f"The finger's load found is {_FAR} touch."
        if verdict.sizes is not None and verdict.evidence is not Evidence.WORSE:
            if self._sizes.allows(verdict.sizes):
                self._sizes.take(verdict.sizes)
            else:
                far = f"The contacts' size found is {_FAR} trackpad."
        if self._adoption.is_moving or self._is_due:
            return refusal or far
        if verdict.evidence is not Evidence.WORSE:  # which takes back, whatever was found
            if change is not None and not change.is_near(self._scanned):
                return f"The map found, or the sensors, is {_FAR} scan, and resonance."
            if correction is not None and not self._adoption.allows(correction):
                return f"The pad found is {_FAR} trackpad."
        if not self._trust.take(verdict.evidence, correction, change):
            return refusal or far
        self._move()
        if verdict.evidence is Evidence.WORSE:
            self._sizes.take_back()
            self._taken_back += 1
            return _TAKEN_BACK
        self._adopted += 1
        return far

    def _move(self) -> None:
        """Begin to move to as much as is trusted of what was found."""
        trust = self._trust
        self._adoption.request(trust.correction.part(trust.share))
        log.info(
            "the touches show the pad elsewhere by %s mm: adopting it", [round(mm, 3) for mm in trust.correction[1]]
        )
        if trust.change is not None:
            self._change, self._is_due = trust.change.part(trust.share, self._scanned, self._uncertainty), True
        elif self._change is not None:
            self._change, self._is_due = PlateChange.none(self._scanned, self._uncertainty), True

    def step(self, machine: Machine, t_now_ns: int) -> bool:
        """Take the next small step, if one is due; all else, if no finger is down and nothing is requested.

        Returns whether it did either.
        """
        is_plate = (self._is_due or self._is_load_due or self._sizes.is_due) and machine.is_idle
        if is_plate:
            self._adopt_plate(machine, t_now_ns)
        if not self._adoption.is_moving or t_now_ns - self._t_stepped_ns < STEP_EVERY_NS:
            return is_plate
        self._t_stepped_ns = t_now_ns
        pad = self._adoption.step()
        if pad is not None:
            self._steps += 1
            machine.adopt(astuple(pad.plate_from_pad), pad.latency_ns, t_now_ns)
        return is_plate or pad is not None

    def _adopt_plate(self, machine: Machine, t_now_ns: int) -> None:
        if self._is_due:
            self._is_due = False
            self._maps += 1
            self._give_change(machine, t_now_ns)
        if self._is_load_due:
            self._is_load_due = False
            self._loads += 1
            self._give_load(machine, t_now_ns)
        if self._sizes.is_due:
            self._sizes.is_due = False
            self._give_sizes(machine, t_now_ns)

    def _give_change(self, machine: Machine, t_now_ns: int) -> None:
        if self._change is not None:
            machine.adopt_map(self._change.shapes, self._change.steepest_1_mm, t_now_ns)
            machine.adopt_readings(self._change.d, self._change.q, t_now_ns)
            self._unknown = self._change.unknown
            machine.adopt_uncertainty(*self._unknown, t_now_ns)

    def _give_load(self, machine: Machine, t_now_ns: int) -> None:
        if self._load_1_s is not None:
            machine.adopt_load(self._load_1_s.real, -self._load_1_s.imag, t_now_ns)

    def _give_sizes(self, machine: Machine, t_now_ns: int) -> None:
        if self._sizes.now is not None:
            machine.adopt_contacts(*self._sizes.now, t_now_ns)

    def resume(self, machine: Machine, t_now_ns: int) -> None:
        """Give a machine that begins what the one before had."""
        pad = self._adoption.now
        if pad != self._adoption.configured:
            machine.adopt(astuple(pad.plate_from_pad), pad.latency_ns, t_now_ns)
        if not self._is_due:
            self._give_change(machine, t_now_ns)
        if not self._is_load_due:
            self._give_load(machine, t_now_ns)
        if not self._sizes.is_due:
            self._give_sizes(machine, t_now_ns)

    def report(self) -> dict[str, object]:
        """For `status`."""
        now, configured = self._adoption.now, self._adoption.configured
        return {
            "running": self.process is not None,
            "moving": self._adoption.is_moving,
            "verdicts": self._verdicts,
            "adopted": self._adopted,
            "taken_back": self._taken_back,
            "steps": self._steps,
            "maps": self._maps,
            "loads": self._loads,
            "dropped": self._dropped,
            "moved_mm": now.distance_mm(configured),
            "latency_ms": now.latency_ns * 1e-6,
            "last_refusal": self._last,
            "last_map_refusal": self._last_of_map,
            "next_place": self._next_place,
            "map_sigma": self._map_sigma,
            "contacts": self._sizes.report(),
            "unknown": self._unknown._asdict(),
            "sentence": self._sentence(),
        }

    def _sentence(self) -> str:
        """Say what is adopted of what touches showed, and why no more; "" before the first verdict."""
        moved_mm = self._adoption.now.distance_mm(self._adoption.configured)
        part = "half of " if self._trust.share < 1.0 else ""
        known = (
            (f"the pad, by {moved_mm:.2f} mm", moved_mm > 0.0),
            (f"{part}map and sensors", self._trust.change is not None and not self._is_due),
            ("a finger's load", self._loads > 0),
            ("the contacts' size", self._sizes.report() is not None),
        )
        adopted = ", ".join(name for name, is_adopted in known if is_adopted)
        known_too = self._map_known if self._trust.change is not None and not self._is_due else ""
        why = " ".join(dict.fromkeys(one for one in (known_too, self._last, self._last_of_map) if one))
        if not self._verdicts:
            return ""
        return f"{f'Adopted: {adopted}.' if adopted else 'Nothing is adopted.'} {why}".strip()

    def close(self) -> None:
        """End the process."""
        process, self.process = self.process, None
        if process is None:
            return
        self._out.clear()
        process.kill()
        for pipe, remove in ((process.stdin, self._loop.remove_writer), (process.stdout, self._loop.remove_reader)):
            assert pipe is not None
            remove(pipe)
            pipe.close()
        process.wait()


def _fields(kind: str, t_ns: int, values: Sequence[Any]) -> Fields:
    fields = record_of(kind, 0, t_ns, tuple(values)).fields
    return {name: fields[name] for name in _PASS_FIELDS if name in fields} if kind == "pass" else fields
