"""A minute of guided touching, recorded: on the running service, or of simulated fingers that follow the guide."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ...design.touch.guide import GUIDED_S, GuidedPlaces, places_at
from ...errors import HapticdError
from ...sim.fingers.scenarios import LAND_S

CLIENT = "calibrate-touch"
SIMULATED_PLATE = "fingertip"
TELEMETRY_HZ = 500
_SLIPPERY_UM, _STICKY_UM = 1.0, 0.0
_EVERY_S = 1.0


class Guide:
    """Says where to touch from the recording's start on; `begin` is called then."""

    def __init__(
        self,
        begin: Callable[[], None],
        say: Callable[[str], None] = lambda text: print(text, flush=True),
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._begin, self._say, self._now_s = begin, say, now_s
        self._t_begun_s: float | None = None
        self._t_said_s = 0.0
        self._places: GuidedPlaces | None = None

    def notify(self, text: str) -> None:
        """Pass on what the recorder says."""
        from ..record import attach

        self._say(text)
        if text != attach.WAITING and self._t_begun_s is None:
            self._t_begun_s = self._now_s()
            self._begin()

    def is_ended(self) -> bool:
        """Say the next place each second; return whether the guided time is over."""
        if self._t_begun_s is None:
            return False
        t_s = self._now_s() - self._t_begun_s
        places = places_at(t_s)
        if self._places is None or places[:2] != self._places[:2] or t_s - self._t_said_s >= _EVERY_S:
            self._places, self._t_said_s = places, t_s
            self._say(places.sentence(max(GUIDED_S - t_s, 0.0)))
        return t_s >= GUIDED_S


def record(path: Path, *, is_simulated: bool, seed: int, endpoint: str | None = None) -> None:
    """Record to `path`, replacing what an earlier run wrote. Raises HapticdError."""
    import hapticd_client

    from ...config.sections import Config, RecordConfig
    from ...sim.plate.ground_truth import PlateSettings
    from ...sim.settings import Settings
    from ..record import attach, simulated  # late, with the recorder and the daemon

    path.unlink(missing_ok=True)
    if is_simulated:
        plate = PlateSettings.of(SIMULATED_PLATE)
        settings = Settings(config=Config(record=RecordConfig(telemetry_hz=TELEMETRY_HZ)), plate=plate)
        print(f"Simulated fingers follow the guide for {GUIDED_S:.0f} s.", file=sys.stderr, flush=True)
        simulated.run("guided", path, settings=settings, seed=seed, seconds=GUIDED_S + LAND_S)
        return
    try:
        with hapticd_client.Client(endpoint, name=CLIENT) as client:
            guide = Guide(lambda: _lay(client))
            directory = None if endpoint is None else Path(endpoint)
            print(attach.record(path, directory, None, notify=guide.notify, is_ended=guide.is_ended), flush=True)
    except hapticd_client.HapticdError as error:
        raise HapticdError(str(error)) from None


def _lay(client: Any) -> None:
    """Make the plate slippery on one side of a line on which no two guided places lie, and sticky on the other."""
    from hapticd_client import Polygon

    half_x, half_y = (size_mm / 2.0 for size_mm in client.plate()["size_mm"])
    upper, lower = (-half_y / 2.0, half_y), (half_y / 2.0, -half_y)
    left = Polygon(((-half_x, -half_y), lower, upper, (-half_x, half_y)))
    right = Polygon((lower, (half_x, -half_y), (half_x, half_y), upper))
    client.surface("slippery", left, amplitude_um=_SLIPPERY_UM)
    client.surface("sticky", right, amplitude_um=_STICKY_UM)
