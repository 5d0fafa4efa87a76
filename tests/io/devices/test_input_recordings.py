"""Recordings of `libinput record` and `evemu-record`: another program's touchscreen, played as if it were here."""

from __future__ import annotations

import asyncio
import functools
import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest
from asynchronous import VirtualTimeLoop, asynchronous
from listener import Listener

from hapticd.errors import TrackpadError
from hapticd.io.devices.replay import MAX_LINES, ReplayTrackpad, read_recording
from hapticd.values import TouchFrame
from hapticd.wire.trackpad import Decoder

in_virtual_time = functools.partial(asynchronous, loop_factory=VirtualTimeLoop)

Event = tuple[int, int, int, int]  # milliseconds, type, code, value
SCREEN = {0x2F: (0, 9, 0), 0x35: (0, 3440, 10), 0x36: (0, 1940, 20), 0x39: (0, 65535, 0), 0x3A: (0, 255, 0)}
BUTTONS = {0x00: (0, 100, 1), 0x01: (0, 100, 1)}
STROKE: list[Event] = [
    *((0, 3, 0x39, 7), (0, 3, 0x35, 1720), (0, 3, 0x36, 970), (0, 3, 0x3A, 51), (0, 1, 330, 1), (0, 0, 0, 0)),
    *((8, 3, 0x35, 1730), (8, 0, 0, 0)),
    *((16, 3, 0x35, 1740), (16, 0, 0, 0)),
    *((216, 3, 0x39, -1), (216, 1, 330, 0), (216, 0, 0, 0)),
]


def evemu(axes: dict[int, tuple[int, int, int]], events: list[Event], *, version: str = "# EVEMU 1.3\n") -> str:
    head = f'{version}# Input device name: "screen"\nN: my screen\nI: 0003 1234 5678 0100\nP: 02 00 00 00 00 00 00 00\n'
    declared = "".join(f"A: {code:02x} {low} {high} 0 0 {per_mm}\n" for code, (low, high, per_mm) in axes.items())
    said = [
        f"E: {ms // 1000}.{ms % 1000:03d}000 {kind:04x} {code:04x} {value}\t# what\n"
        for ms, kind, code, value in events
    ]
    return head + "B: 00 0b 00 00 00 00 00 00 00\n" + declared + "#  Waiting for events  #\n" + "".join(said)


def node(axes: dict[int, tuple[int, int, int]], events: list[Event], name: str = "my screen") -> str:
    declared = "".join(f"      {code}: [{low}, {high}, 0, 0, {per_mm}]\n" for code, (low, high, per_mm) in axes.items())
    said = "".join(
        f"    - [{ms // 1000:3d}, {ms % 1000 * 1000:6d}, {kind:3d}, {code:3d}, {value:7d}] # what {value} (+3)\n"
        for ms, kind, code, value in events
    )
    evdev = (
        f'  evdev:\n    # Name: {name}\n    name: "{name}"\n    id: [3, 4660, 22136, 256]\n    codes:\n'
        f"      0: [0, 1, 2, 3, 4] # EV_SYN\n      3: [47, 53, 54, 57, 58] # EV_ABS\n    absinfo:\n{declared}"
    )
    udev = "    properties: [1]\n  udev:\n    properties:\n    - ID_INPUT=1\n  quirks:\n  events:\n"
    libinputs = "  - libinput:\n    - {time: 0.000, type: TOUCH_DOWN, slot: 0}\n"
    return f"- node: /dev/input/event9\n{evdev}{udev}  # Current time is 12:34:56\n  - evdev:\n{said}{libinputs}"


def libinput(*nodes: str) -> str:
    head = '# libinput record\nversion: 1\nndevices: 1\nlibinput:\n  version: "1.23.0"\n'
    return head + 'system:\n  kernel: "6.1.0"\ndevices:\n' + "".join(nodes)


def libinput_screen(axes: dict[int, tuple[int, int, int]], events: list[Event]) -> str:
    return libinput(node(axes, events))


def evtest(axes: dict[int, tuple[int, int, int]], events: list[Event]) -> str:
    declared = "".join(
        f"    Event code {code} (ABS_WHAT)\n      Value     {low}\n      Min       {low}\n      Max     {high}\n"
        + f"      Resolution      {per_mm}\n" * (per_mm > 0)
        for code, (low, high, per_mm) in axes.items()
    )
    said = "".join(
        f"Event: time 17000{ms // 1000:05d}.{ms % 1000:03d}000, "
        + (
            f"type {kind} (EV), code {code} (WHAT), value {value}\n"
            if kind
            else "-------------- SYN_REPORT ------------\n"
        )
        for ms, kind, code, value in events
    )
    return (
        "Input driver version is 1.0.1\nInput device ID: bus 0x3 vendor 0x1 product 0x2 version 0x100\n"
        'Input device name: "my screen"\nSupported events:\n  Event type 0 (EV_SYN)\n  Event type 1 (EV_KEY)\n'
        f"    Event code 53 (KEY_WHAT)\n  Event type 3 (EV_ABS)\n{declared}Properties:\n"
        f"  Property type 1 (INPUT_PROP_DIRECT)\nTesting ... (interrupt to exit)\n{said}"
    )


each_program = pytest.mark.parametrize("text_of", [evemu, libinput_screen, evtest])
DATA = Path(__file__).parents[2] / "data"  # as the programs themselves wrote them in the emulated machine
Writer = Callable[[dict[int, tuple[int, int, int]], list[Event]], str]


def written(folder: Path, text: str) -> Path:
    path = folder / "touch.yml"
    path.write_text(text, encoding="utf-8")
    return path


def frames(path: Path, size_mm: tuple[float, ...] = ()) -> list[TouchFrame]:
    pad, reports = read_recording(path, size_mm)
    decoder = Decoder(pad)
    return [frame for report in reports for frame in decoder.decode(report.data, report.t_host_ns)]


@each_program
def test_a_recording_has_the_device_and_each_report_with_its_time(tmp_path: Path, text_of: Writer) -> None:
    path = written(tmp_path, text_of(SCREEN, STROKE))
    pad, reports = read_recording(path)
    assert (pad.name, pad.source, pad.geometry.width_mm, pad.geometry.height_mm) == ("my screen", "evdev", 344.0, 97.0)
    assert pad.geometry.pressure_max_raw == 255
    begin_ns = reports[0].t_host_ns
    assert [report.t_host_ns - begin_ns for report in reports] == [0, 8_000_000, 16_000_000, 216_000_000]
    seen = [
        [(one.contact_id, one.x_mm, one.y_mm, one.pressure_frac) for one in frame.contacts] for frame in frames(path)
    ]
    assert seen == [[(7, 0.0, 0.0, 0.2)], [(7, 1.0, 0.0, 0.2)], [(7, 2.0, 0.0, 0.2)], []]


def test_recordings_by_libinput_1_22_and_evemu_2_7_give_the_same_contacts() -> None:
    written_by = [frames(DATA / name) for name in ("touchscreen-libinput-1.22.yml", "touchscreen-evemu-2.7.txt")]
    places = [[[(one.raw_x, one.raw_y) for one in frame.contacts] for frame in each] for each in written_by]
    assert places[0] == places[1]
    assert [len(there) for there in places[0]] == [1, 2, *[3] * 21, 2, 1, 0]
    assert places[0][2] == [(974, -1213), (2229, -267), (1515, -1875)]
    pad, reports = read_recording(DATA / "touchscreen-libinput-1.22.yml")
    assert (pad.name, pad.geometry.width_mm, pad.geometry.height_mm) == ("virtual touchscreen", 344.0, 97.0)
    assert reports[-1].t_host_ns - reports[0].t_host_ns == 1_302_349_000


def test_of_several_devices_the_first_with_touches_is_played(tmp_path: Path) -> None:
    mouse = node(BUTTONS, [(0, 2, 0, 5), (0, 0, 0, 0)], "a mouse")
    other = node(SCREEN | {0x35: (0, 100, 1)}, [(0, 3, 0x39, 9), (0, 0, 0, 0)], "another screen")
    pad, reports = read_recording(written(tmp_path, libinput(mouse, node(SCREEN, STROKE), other)))
    assert (pad.name, pad.geometry.width_mm, len(reports)) == ("my screen", 344.0, 4)


@each_program
@pytest.mark.parametrize(
    ("events", "reason"),
    [
        ([(8, 0, 0, 0), (7, 0, 0, 0)], "before that of the report above"),
        ([(0, 3, 0x35, 1 << 31), (0, 0, 0, 0)], "its value 32"),
    ],
)
def test_a_bad_event_is_named_by_its_line(tmp_path: Path, text_of: Writer, events: list[Event], reason: str) -> None:
    with pytest.raises(TrackpadError, match=rf"touch\.yml, line \d+: .*{reason}"):
        read_recording(written(tmp_path, text_of(SCREEN, events)))


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("    - [0, 1000000, 0, 0, 0]", "below a million"),
        ("    - [0, 0, 65536, 0, 0]", "16 bits"),
        ("    absinfo:\n      53: [0, 9999999999, 0, 0, 1]", "32 bits"),
    ],
)
def test_numbers_beyond_the_kernels_are_refused(tmp_path: Path, line: str, reason: str) -> None:
    with pytest.raises(TrackpadError, match=reason):
        read_recording(written(tmp_path, f"# libinput record\n- node: a\n{line}\n"))


@each_program
@pytest.mark.parametrize("before", ["# from a bug tracker\n", "\n\n", "---\n", "\ufeff", "> hello,\n> see below\n\n"])
def test_lines_before_the_header_are_passed_over(tmp_path: Path, text_of: Writer, before: str) -> None:
    whole = read_recording(written(tmp_path, text_of(SCREEN, STROKE)))
    assert read_recording(written(tmp_path, before + text_of(SCREEN, STROKE))) == whole


def events_only(text: str) -> str:
    """Without what the device declares."""
    return "".join(line for line in text.splitlines(keepends=True) if re.match(r"E: | *- \[|Event: ", line))


GETEVENT = "[   78826.389007] /dev/input/event2: EV_ABS       ABS_MT_POSITION_X    00000205\n"


@pytest.mark.parametrize(
    ("text", "program", "missing"),
    [
        (events_only(evemu(SCREEN, STROKE)), "evemu-record", "N: and A:"),
        (events_only(libinput_screen(SCREEN, STROKE)), "libinput record", "absinfo:"),
        (events_only(evtest(SCREEN, STROKE)), "evtest", "Supported events:"),
        (GETEVENT, "getevent", "ranges"),
        ("# of Android\n" + GETEVENT.replace("EV_ABS       ABS_MT_POSITION_X   ", "0003 0035"), "getevent", "ranges"),
        (GETEVENT.partition("] ")[2], "getevent", "ranges"),
        ("Dear Sir,\n", "libinput record, evemu-record or evtest", "make one"),
        ("", "libinput record, evemu-record or evtest", "make one"),
    ],
)
def test_what_is_missing_is_named_with_the_program_that_wrote_it(
    tmp_path: Path, text: str, program: str, missing: str
) -> None:
    with pytest.raises(TrackpadError, match=rf"touch\.yml.*{program}") as refused:
        read_recording(written(tmp_path, text))
    assert missing in str(refused.value)


def test_a_report_keeps_at_most_an_event_per_axis_and_a_device_bounded_axes(tmp_path: Path) -> None:
    events: list[Event] = [(0, 3, 0x35, value) for value in range(5000)]
    pad, reports = read_recording(written(tmp_path, evemu(SCREEN, [*events, (0, 0, 0, 0)])))
    assert len(reports[0].data) == 170 * 24
    many = SCREEN | dict.fromkeys(range(0x100, 0x400), (0, 1, 0))
    assert read_recording(written(tmp_path, evemu(many, STROKE)))[0] == pad
    assert MAX_LINES == 4_000_000


@in_virtual_time
async def test_a_finger_that_lay_still_is_repeated_until_it_is_lifted(tmp_path: Path) -> None:
    """The kernel says nothing for 200 ms, after which the service would count it as lifted."""
    loop, listener = asyncio.get_running_loop(), Listener()
    path = written(tmp_path, evemu(SCREEN, STROKE))
    source = ReplayTrackpad(path, clock_ns=lambda: 900 + round(loop.time() * 1e9))
    source.start(loop, listener.on_reports, listener.on_link)
    await listener.until(lambda: len(listener.links) == 2)
    times_ms = [(report.t_host_ns - 900) * 1e-6 for report in listener.reports]
    assert times_ms[:3] == [0.0, 8.0, 16.0]
    assert max(after - before for before, after in pairwise(times_ms)) < 15.0
    assert listener.events[-1] == (None, "replay ended")
    decoder = Decoder(read_recording(path)[0])
    contacts = [decoder.decode(report.data, report.t_host_ns)[-1].contacts for report in listener.reports]
    assert len(contacts) > 20
    assert {(one[0].x_mm, one[0].y_mm) for one in contacts[2:-1]} == {(2.0, 0.0)}
    assert contacts[-1] == ()
    await source.close()
