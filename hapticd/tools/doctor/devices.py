"""Trackpad and board: found, ours to open, how often the one reports and what the other runs."""

from __future__ import annotations

import asyncio
import grp
import os
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median

from ...errors import DeviceError, HapticdError
from ...io.devices.hid_trackpad import HidTrackpad, find_pads, load_hid
from ...io.devices.serial_link import SerialLink
from ...io.devices.trackpad_source import TrackpadSource
from ...values import RawReport
from ...wire.trackpad import Decoder
from ..firmware.conversation import Conversation
from .finding import FAIL, PASS, WARN, Finding, Patient, is_ours
from .host import INSTALL
from .service import again

LISTEN_S = 2.0
LOOK_EVERY_S = 0.25
SLOW_FRAC = 0.9  # of the rate that the configuration expects
TOUCH = "stroke the pad with a finger while `hapticd doctor` runs: it reports while it is touched"
FASTER = "a cable instead of Bluetooth; else prediction.period_ms in the configuration"
IDLER = "leave the processor to the simulated pad: `top` shows who has it"


def trackpad(patient: Patient) -> Finding:
    """The pad on this machine."""
    if not patient.has_pad:
        return Finding(PASS, "trackpad", f"{patient.config.trackpad.source} asked for")
    try:
        pads = list(find_pads(load_hid(), patient.config.trackpad.model))
    except (HapticdError, OSError) as error:
        return Finding(FAIL, "trackpad", str(error), "pip install hidapi")
    if not pads:
        remedy = "plug it in, or bluetoothctl connect ADDRESS, and wake it"
        return Finding(FAIL, "trackpad", "none is connected", remedy)
    pad, path = pads[0]
    node = os.fsdecode(path)
    if node.startswith("/dev/") and not is_ours(Path(node)) and patient.status is None:
        return Finding(FAIL, "trackpad", f"{node} is not yours to open", f"{INSTALL}, then replug it")
    return Finding(PASS, "trackpad", f"{pad.model} at {node}")


def rate(patient: Patient, wait: Callable[[float], None] = time.sleep) -> Finding:
    """How often the pad reports: as the daemon counts it, or read here where no daemon runs."""
    if patient.status is not None:
        measured_hz = _counted_rate_hz(patient, wait)
    elif patient.has_pad:
        try:
            measured_hz = listen(HidTrackpad(patient.config.trackpad.model), LISTEN_S)
        except HapticdError as error:
            return Finding(WARN, "report rate", str(error), "see trackpad above")
    else:
        return Finding(PASS, "report rate", "no daemon answers, and no pad is asked for")
    if measured_hz is None:
        return Finding(WARN, "report rate", f"nothing was touched for {LISTEN_S:g} s", TOUCH)
    expected_hz = 1e3 / patient.config.prediction.period_ms
    said = f"{measured_hz:.1f} Hz, the configuration expects {expected_hz:.1f}"
    if measured_hz < SLOW_FRAC * expected_hz:
        return Finding(WARN, "report rate", said, FASTER if patient.has_pad else IDLER)
    return Finding(PASS, "report rate", said)


def _counted_rate_hz(patient: Patient, wait: Callable[[float], None]) -> float | None:
    samples = []
    for _ in range(round(LISTEN_S / LOOK_EVERY_S) + 1):
        frames, t_ns = patient.told("trackpad", "reports", "frames"), patient.told("t_ns")
        if isinstance(frames, int) and isinstance(t_ns, int):
            samples.append((t_ns, frames))
        wait(LOOK_EVERY_S)
        patient = again(patient)
    return steady_rate_hz(samples)


def steady_rate_hz(samples: Sequence[tuple[int, int]]) -> float | None:
    """The rate over the longest run of (t_ns, counter) in which the counter never stood; None without any.

    A run that a finger begins or ends would be counted short, so its first and its last step are left out where
    enough remain.
    """
    runs: list[list[tuple[int, int]]] = [[]]
    for sample in samples:
        if runs[-1] and not (sample[1] > runs[-1][-1][1] and sample[0] > runs[-1][-1][0]):
            runs.append([])
        runs[-1].append(sample)
    longest = max(runs, key=len)
    if len(longest) >= 5 and len(longest) < len(samples):
        longest = longest[1:-1]
    if len(longest) < 2:
        return None
    (t_first_ns, first), (t_last_ns, last) = longest[0], longest[-1]
    return (last - first) / ((t_last_ns - t_first_ns) * 1e-9)


def listen(source: TrackpadSource, seconds: float) -> float | None:
    """Read the pad for so long: the median rate of its touch frames, None without any. Raises HapticdError."""
    reports: list[RawReport] = []
    links: list[tuple[bool, str]] = []

    async def read() -> None:
        source.start(asyncio.get_running_loop(), reports.extend, lambda up, why: links.append((up, why)))
        try:
            await asyncio.sleep(seconds)
        finally:
            await source.close()

    asyncio.run(read())
    if not any(up for up, _ in links):
        raise HapticdError(links[-1][1] if links else "the pad did not open")
    return frame_rate_hz(reports, source.model or "")


def frame_rate_hz(reports: Sequence[RawReport], model: str) -> float | None:
    """Of the touch frames in raw reports, from the median of their distances on the pad's clock."""
    decoder = Decoder(model)
    t_ns = [frame.t_ns for report in reports for frame in decoder.decode(report.data, report.t_host_ns)]
    gaps_ns = [later - earlier for earlier, later in pairwise(t_ns) if later > earlier]
    return 1e9 / median(gaps_ns) if gaps_ns else None


def board(patient: Patient) -> Finding:
    """The serial port."""
    port = patient.config.device.port
    if not patient.has_board:
        return Finding(PASS, "board", "simulated")
    if not Path(port).exists():
        return Finding(FAIL, "board", f"there is no {port}", "plug the board in; ls /dev/ttyACM* /dev/ttyUSB*")
    if not is_ours(Path(port)) and patient.status is None:
        remedy = f"sudo usermod -aG {_group(Path(port))} $USER, then log in again"
        return Finding(FAIL, "board", f"{port} is not yours to open", remedy)
    return Finding(PASS, "board", f"{port} can be opened" if patient.status is None else f"{port} is there")


def _group(path: Path) -> str:
    """The group that a device belongs to, by its name where it has one."""
    number = path.stat().st_gid
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def firmware(patient: Patient) -> Finding:
    """Which firmware the board runs: as the daemon was told, or asked here where no daemon runs."""
    if patient.status is not None:
        refused, version = patient.told("board", "refused"), patient.told("board", "firmware")
        if refused:
            return Finding(FAIL, "firmware", str(refused), "make -C firmware flash")
        if version is None or not patient.told("board", "ready"):
            return Finding(WARN, "firmware", "the board does not answer the daemon", "journalctl -u hapticd -n 20")
        return Finding(PASS, "firmware", f"version {version}, as the daemon was told")
    port = patient.config.device.port
    if not patient.has_board:
        return Finding(PASS, "firmware", "the simulated board's is this package's")
    if not (Path(port).exists() and is_ours(Path(port))):
        return Finding(WARN, "firmware", "not asked, for the port is not ours", "see board above")
    try:
        baud = patient.config.device.baud
        version = asyncio.run(greeted(SerialLink(port, baud), f"{port} at {baud} baud"))
    except DeviceError as error:
        return Finding(FAIL, "firmware", str(error), f"hapticd firmware info --port {port}")
    return Finding(PASS, "firmware", f"version {version}, of this protocol")


async def greeted(link: SerialLink, where: str) -> str:
    """The version of the firmware at the other end. Raises DeviceError."""
    async with Conversation(link, where) as conversation:
        return conversation.hello.firmware_version
