"""Checks of trackpad and board: presence, access rights, report rate, firmware version."""

from __future__ import annotations

import asyncio
import grp
import os
import time
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from ...config.sections import TUIO_ADDRESS
from ...errors import DeviceError, HapticdError, pip_install, requirements
from ...io.devices import input_nodes, tuio_trackpad
from ...io.devices.hid_trackpad import find_pads, load_hid
from ...io.devices.serial_link import SerialLink
from ...io.devices.trackpad_source import TrackpadSource
from ...values import RawReport
from ...wire import osc
from ...wire.trackpad import Decoder, Pad
from .. import pads
from ..firmware.conversation import Conversation
from .finding import FAIL, PASS, WARN, CheckResult, System, is_accessible
from .host import INSTALL
from .service import refreshed

LISTEN_S = 2.0
LOOK_EVERY_S = 0.25
FAR_HZ = 50.0  # of the drive: a warm plate goes by less
MOST_REFUSED_FRAC = 0.01  # of a tracker's frames: as many come from its new socket when it restarts
SLOW_FRAC = 0.9  # of the rate that the configuration expects
TOUCH = "stroke the pad with a finger while `hapticd doctor` runs: it reports only while touched"
TO_INPUT = "sudo usermod -aG input $USER, then log in again"
PLUG_IN = "plug it in: see /proc/bus/input/devices"
FASTER = "use a cable instead of Bluetooth; else set prediction.period_ms"
IDLER = "reduce the host's load, which slows the simulated pad: see `top`"


def trackpad(system: System) -> CheckResult:
    """Check for a connected pad."""
    source = system.config.trackpad.source
    if not system.has_pad:
        return CheckResult(PASS, f"{source} is configured")
    require, extra = _PACKAGES.get(source, (None, ""))
    try:
        if require is not None:
            require()
    except HapticdError:
        return CheckResult(FAIL, f"{source} needs the extra {extra}", pip_install(*requirements(extra)))
    return _CHECKS[source](system)


def _hid(system: System) -> CheckResult:
    try:
        found = list(find_pads(load_hid(), system.config.trackpad.device))
    except (HapticdError, OSError) as error:
        return CheckResult(FAIL, str(error), pip_install("hidapi"))
    if not found:
        remedy = "plug it in, or bluetoothctl connect ADDRESS, and wake it"
        return CheckResult(FAIL, "none is connected", remedy)
    pad, path = found[0]
    node = os.fsdecode(path)
    if node.startswith("/dev/") and not is_accessible(Path(node)) and system.status is None:
        return CheckResult(FAIL, f"{node} cannot be opened by this user", f"{INSTALL}, then replug it")
    return CheckResult(PASS, f"{pad.model} at {node}")


def _evdev(system: System) -> CheckResult:
    configured = system.config.trackpad
    nodes = sorted(input_nodes.FOLDER.glob("event*"))
    try:
        node = next(input_nodes.find_nodes(configured.device), None)
    except OSError as error:
        remedy = TO_INPUT if isinstance(error, PermissionError) else PLUG_IN
        return CheckResult(FAIL, f"{configured.device} cannot be opened ({error.strerror})", remedy)
    if node is None:
        if not all(is_readable(path) for path in nodes):
            return CheckResult(FAIL, "none that this user may read is connected", TO_INPUT)
        wanted = f"named {configured.device!r}" if configured.device else "that reports contacts"
        return CheckResult(FAIL, f"no device {wanted} is connected", PLUG_IN)
    try:
        pad = input_nodes.describe(node, configured.size_mm)
        slots, path = node.slot_count(), node.path
    except (HapticdError, OSError) as error:
        return CheckResult(FAIL, str(error), "set trackpad.size_mm, or trackpad.device to another device")
    finally:
        node.close()
    size = f"{pad.geometry.width_mm:.0f} x {pad.geometry.height_mm:.0f} mm"
    kind = f"{slots} contacts" if slots else "contacts without numbers (protocol A)"
    return CheckResult(PASS, f"{pad.name} at {path}: {size}, {kind}")


def _tuio(system: System) -> CheckResult:
    address = system.config.trackpad.device or TUIO_ADDRESS
    try:
        tuio_trackpad.bound(address).close()
    except OSError as error:
        if system.status is not None:
            counted = system.reported("inputs", "trackpad")
            return _heard(counted if isinstance(counted, dict) else {}, address)
        return CheckResult(FAIL, f"{address} cannot be bound ({error.strerror})", "set trackpad.device")
    return CheckResult(PASS, f"{address} is free for a TUIO tracker")


def _heard(counted: Mapping[str, Any], address: str) -> CheckResult:
    """Judge what came from a tracker, by the counters of its source."""
    count = {name: value if isinstance(value, int) else 0 for name, value in counted.items()}
    for name, missing, text, remedy in _UNHEARD:
        if count.get(name) and not count.get(missing):
            return CheckResult(WARN, text.format_map(counted), remedy)
    refused = {name: count.get(name, 0) for name in ("other_address", "other_sender", "left_out")}
    if sum(refused.values()) > MOST_REFUSED_FRAC * count.get("frames", 0):
        found = ", ".join(f"{value} {name.replace('_', ' ')}" for name, value in refused.items() if value)
        return CheckResult(WARN, f"datagrams at {address} that were not taken: {found}", OTHER_SENDERS)
    if not count.get("frames"):
        return CheckResult(PASS, f"a TUIO tracker's datagrams are awaited at {address}")
    return CheckResult(PASS, f"{counted.get('sender') or 'a tracker'} sends to {address}")


_UNHEARD = (  # the counter of what a tracker sends, that of what has not come of it, and what it means
    ("other_address", "frames", "datagrams come from {refused_address} alone", "set trackpad.tuio_sender to it"),
    ("unended", "frames", "each datagram is alone, none ends a frame (`fseq`)", "send a frame as one OSC bundle"),
    (
        "outside",
        "contacts",
        "positions are no shares of the surface (0 to 1)",
        "let it send 0 to 1, no pixels",
    ),
    ("hovering", "contacts", "all fingers are above the surface", "touch it; calibrate the tracker's height"),
    ("other_profiles", "frames", "a tracker sends objects and no fingers", "let it send /tuio/2Dcur or /tuio2/ptr"),
    ("length", "frames", "datagrams are damaged or longer than 4096 bytes", "let the tracker send shorter bundles"),
    ("foreign", "frames", "datagrams are no frames of TUIO 1.1 or 2.0", "see what sends there: sudo ss -uanp"),
)
OTHER_SENDERS = "another program sends to that port, and could touch the plate: sudo ss -uanp shows both"


def is_readable(path: Path) -> bool:
    """Return whether this user may read it."""
    return os.access(path, os.R_OK)


_CHECKS: dict[str, Callable[[System], CheckResult]] = {"hid": _hid, "evdev": _evdev, "tuio": _tuio}
_PACKAGES = {"evdev": (input_nodes.require_package, "touchscreen"), "tuio": (osc.require_package, "osc")}


def rate(system: System, wait: Callable[[float], None] = time.sleep) -> CheckResult:
    """Check the report rate: the daemon's count, or measured here if no daemon runs."""
    heard = None
    if system.status is not None:
        measured_hz = _counted_rate_hz(system, wait)
    elif system.has_pad:
        try:
            source = pads.connected(system.config.trackpad)
            measured_hz = listen(source, LISTEN_S)
            if isinstance(source, tuio_trackpad.TuioTrackpad) and any(source.counters.values()):
                heard = _heard(source.counters, system.config.trackpad.device or TUIO_ADDRESS)
        except HapticdError as error:
            return CheckResult(WARN, str(error), "see trackpad above")
    else:
        return CheckResult(PASS, "no daemon answers, and no pad is configured")
    if measured_hz is None:
        return heard or CheckResult(WARN, f"no touch within {LISTEN_S:g} s", TOUCH)
    expected_hz = 1e3 / system.config.prediction.period_ms
    text = f"{measured_hz:.1f} Hz, the configuration expects {expected_hz:.1f}"
    if measured_hz < SLOW_FRAC * expected_hz:
        return CheckResult(WARN, text, FASTER if system.has_pad else IDLER)
    return CheckResult(PASS, text)


def _counted_rate_hz(system: System, wait: Callable[[float], None]) -> float | None:
    samples = []
    for _ in range(round(LISTEN_S / LOOK_EVERY_S) + 1):
        frames, t_ns = system.reported("trackpad", "reports", "frames"), system.reported("t_ns")
        if isinstance(frames, int) and isinstance(t_ns, int):
            samples.append((t_ns, frames))
        wait(LOOK_EVERY_S)
        system = refreshed(system)
    return steady_rate_hz(samples)


def steady_rate_hz(samples: Sequence[tuple[int, int]]) -> float | None:
    """Return the highest rate of (t_ns, counter) over two steps, as a touch may begin or end meanwhile; None without a
    rising counter. Where another daemon counts from 0 it falls."""
    steps = zip(samples, samples[2:], strict=False)
    rates_hz = [1e9 * (end[1] - begin[1]) / (end[0] - begin[0]) for begin, end in steps if end[0] > begin[0]]
    return max((rate_hz for rate_hz in rates_hz if rate_hz > 0.0), default=None)


def listen(source: TrackpadSource, seconds: float) -> float | None:
    """Read the pad for `seconds`; return the median rate of its touch frames, None without any. Raises HapticdError."""
    reports: list[RawReport] = []
    links: list[tuple[Pad | None, str]] = []

    async def read() -> None:
        source.start(asyncio.get_running_loop(), reports.extend, lambda pad, why: links.append((pad, why)))
        try:
            await asyncio.sleep(seconds)
        finally:
            await source.close()

    asyncio.run(read())
    pads = [pad for pad, _ in links if pad is not None]
    if not pads:
        raise HapticdError(links[-1][1] if links else "the pad could not be opened")
    decoder = Decoder(pads[-1])
    t_ns = [frame.t_ns for report in reports for frame in decoder.decode(report.data, report.t_host_ns)]
    gaps_ns = [later - earlier for earlier, later in pairwise(t_ns) if later > earlier]
    return 1e9 / median(gaps_ns) if gaps_ns else None


def drive(system: System) -> CheckResult:
    """Check how far the drive has gone after the plate."""
    drive_hz, moved_hz = system.reported("board", "drive_hz"), system.reported("board", "drive_moved_hz")
    if not (isinstance(drive_hz, float) and isinstance(moved_hz, float)):
        return CheckResult(PASS, "unknown: no daemon has a status of the board")
    text = f"{drive_hz:.1f} Hz, {moved_hz:+.1f} Hz from where it was set"
    if abs(moved_hz) < FAR_HZ:
        return CheckResult(PASS, text)
    port = system.config.device.port
    return CheckResult(WARN, text, f"measure the plate again: hapticd calibrate resonance --port {port} --out DIR")


def board(system: System) -> CheckResult:
    """Check the serial port."""
    port = system.config.device.port
    if not system.has_board:
        return CheckResult(PASS, "simulated")
    if not Path(port).exists():
        return CheckResult(FAIL, f"{port} does not exist", "plug the board in; ls /dev/ttyACM* /dev/ttyUSB*")
    if not is_accessible(Path(port)) and system.status is None:
        remedy = f"sudo usermod -aG {_group(Path(port))} $USER, then log in again"
        return CheckResult(FAIL, f"{port} cannot be opened by this user", remedy)
    return CheckResult(PASS, f"{port} can be opened" if system.status is None else f"{port} exists")


def _group(path: Path) -> str:
    """Return a device's group, by its name if it has one."""
    number = path.stat().st_gid
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)


def firmware(system: System) -> CheckResult:
    """Check the board's firmware: the daemon's report, or a handshake here if no daemon runs."""
    if system.status is not None:
        refused, version = system.reported("board", "refused"), system.reported("board", "firmware")
        if refused and refused == system.reported("board", "self_test", "text"):
            return CheckResult(WARN, "not driven after its self-test", "see calibration above")
        if refused:
            return CheckResult(FAIL, str(refused), "make -C firmware flash")
        if version is None or not system.reported("board", "ready"):
            lacking = system.reported("board", "lacking") or "the board does not answer the daemon"
            return CheckResult(WARN, str(lacking), "journalctl -u hapticd -n 20")
        crc, baud = system.reported("board", "image_crc"), system.reported("board", "baud")
        image = f", image {crc}" if crc else ""
        line = f", at {baud} baud" if isinstance(baud, int) else ""
        return CheckResult(PASS, f"version {version}{image}{line}, reported to the daemon")
    port = system.config.device.port
    if not system.has_board:
        return CheckResult(PASS, "that of the simulated board, from this package")
    if not (Path(port).exists() and is_accessible(Path(port))):
        return CheckResult(WARN, "not checked: the port cannot be opened", "see board above")
    try:
        baud = system.config.device.baud
        version = asyncio.run(firmware_version(SerialLink(port, baud), f"{port} at {baud} baud"))
    except DeviceError as error:
        return CheckResult(FAIL, str(error), f"hapticd firmware info --port {port}")
    return CheckResult(PASS, f"version {version}, of this protocol")


async def firmware_version(link: SerialLink, where: str) -> str:
    """Return the version of the firmware at the other end. Raises DeviceError."""
    async with Conversation(link, where) as conversation:
        return conversation.hello.firmware_version
