"""Decoder of one trackpad's reports: selects the pad's layout, counts refused reports."""

from __future__ import annotations

from ...values import AffineMap, TouchFrame
from .pad import Pad, RefusedError
from .pads import LAYOUTS, known

_MOUSE = 0x02
_MOUSE_LENGTHS = range(3, 10)  # what a pad sends before the multitouch enable, or after losing it
_CENTRED = AffineMap()


class Decoder:
    """Decode reports of one trackpad to TouchFrames in the plate frame.

    `decode` accepts any bytes: a report that is no whole multitouch report gives no frame, is counted by reason and
    never raises. The constructor raises ValueError for an unknown model; a `Pad` need not be known.

    Every record of a report is in the frame; `touching` marks those that press the glass (Magic Trackpad 2: state 4 or
    5, Magic Trackpad 1: any but 0). A contact missing from a Magic Trackpad 2 frame has ended. On the Magic Trackpad 1
    it stays at its last position until its state is 0 or it is missing for 100 ms.

    `angle_rad` is in [0, pi). Lengths of the contact ellipse follow the kernel (raw byte x 4 in position units);
    their scale is undocumented. `pressure_frac` is raw / 253, on the Magic Trackpad 1 contact size / 63.
    """

    def __init__(self, model: str | Pad, plate_from_pad: AffineMap = _CENTRED) -> None:
        self.pad = known(model) if isinstance(model, str) else model
        self._refused = dict.fromkeys(("foreign", "length", "duplicate_id", "mouse"), 0)
        self._frames = 0
        self.needs_enable = False  # the pad reports as a mouse: it needs the multitouch enable; until a touch frame
        self._layout = LAYOUTS[self.pad.layout](self.pad.geometry, plate_from_pad)

    def place(self, plate_from_pad: AffineMap) -> None:
        """Take the pad to lie elsewhere from the next report on; contacts stay."""
        self._layout.place(plate_from_pad)

    @property
    def counters(self) -> dict[str, int]:
        """Counts since construction: frames decoded, reports refused by reason, steps of the device's clock."""
        return {"frames": self._frames, **self._refused, "clock_steps": self._layout.clock_steps}

    def reset(self) -> None:
        """Discard contacts and clock state, as after a reconnect. Counters stay."""
        self.needs_enable = False
        self._layout.reset()

    def decode(self, report: bytes, t_host_ns: int) -> tuple[TouchFrame, ...]:
        """Return the frames of one report (report id first, as from hidraw): one, two from a 0xF7, none if refused.

        `t_ns` of a frame is the device's millisecond stamp, unwrapped and anchored to the host time of the first
        report; on the Magic Trackpad 1, whose stamp is not understood, it is `t_host_ns`, less one period for the
        first of a pair.
        """
        try:
            frames = self._layout.decode(report, t_host_ns)
        except RefusedError as refused:
            is_mouse = len(self.pad.enable) > 0 and len(report) in _MOUSE_LENGTHS and report[0] == _MOUSE
            self.needs_enable = self.needs_enable or is_mouse
            self._refused["mouse" if is_mouse else refused.reason] += 1
            return ()
        self.needs_enable = False
        self._frames += len(frames)
        return frames
