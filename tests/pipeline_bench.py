"""A pipeline with its scene on a plate whose shapes are sines, and a pad whose fingers move as a test scripts it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hapticd.core.phasors import Phasors
from hapticd.core.pipeline import Pipeline, PipelineSettings
from hapticd.core.plate.contact import disc_points
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.prediction.motion import AdaptivePredictor
from hapticd.core.targets.scene import Scene
from hapticd.core.touch.fingers import FingerPredictor
from hapticd.values import Contact, FingerFrame, FloatArray, LinkTiming, Tick, TouchFrame
from hapticd_contract.contents import Amplitude, Content
from hapticd_contract.surfaces import Polygon, VirtualPath
from hapticd_contract.targets import ClientTargets

MS = 1_000_000
PERIOD_NS = 11_250_000
LINK_NS = 5 * MS
START_NS = 77_000_000_000
FOREVER_NS = 10**15


def sine_plate() -> ModeShapes:
    axis_mm = np.linspace(-68.75, 68.75, 111)
    wave = np.sin(2 * np.pi * axis_mm / 27.0)
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([np.tile(wave, (111, 1)), np.tile(wave, (111, 1)).T]))


PLATE = sine_plate()


class CountedPredictor(FingerPredictor):
    """The default predictor; all of them together count their predictions."""

    predictions = 0

    def __init__(self) -> None:
        self._predictor = AdaptivePredictor()
        self.update = self._predictor.update  # type: ignore[method-assign]
        self.covariance = self._predictor.covariance  # type: ignore[method-assign]

    def predict(self, t_ns: int) -> tuple[float, float]:
        CountedPredictor.predictions += 1
        return self._predictor.predict(t_ns)


class Bench:
    """A pipeline, its scene, and a pad with scripted reports."""

    def __init__(self, **settings: object) -> None:
        self.scene = Scene(w_limit_um=4.0)
        chosen = {"w_limit_um": (4.0, 4.0), "make_predictor": AdaptivePredictor, **settings}
        self.pipeline = Pipeline(PLATE, self.scene, PipelineSettings(**chosen))  # type: ignore[arg-type]
        self.t_ns = START_NS
        self.period_ns = PERIOD_NS
        self.axes_mm = (8.0, 7.0)  # of the contacts, as the pad reports them

    def set_targets(self, targets: dict[int | str, Content], virtuals: dict[str, VirtualPath] | None = None) -> None:
        message = ClientTargets.of("test", FOREVER_NS, targets, virtuals or {})
        assert self.scene.set_targets(message, self.t_ns) == ()

    def touch(
        self, t_device_ns: int, t_read_ns: int, *positions_mm: tuple[float, float], pressure_frac: float = 0.2
    ) -> FingerFrame:
        contacts = tuple(
            Contact(index + 1, x_mm, y_mm, *self.axes_mm, 0.0, pressure_frac, True, 4, 0, 0)
            for index, (x_mm, y_mm) in enumerate(positions_mm)
        )
        return self.pipeline.touch(TouchFrame(t_device_ns, contacts, False), t_read_ns)

    def land(self, wanted_um: dict[tuple[float, float], float]) -> None:
        """Fingers land at these places, and each gets its target amplitude."""
        self.report(*wanted_um)
        self.set_targets({index + 1: Amplitude(um) for index, um in enumerate(wanted_um.values())})

    def report(self, *positions_mm: tuple[float, float], pressure_frac: float = 0.2) -> Tick:
        self.t_ns += self.period_ns
        self.touch(self.t_ns - 10 * MS, self.t_ns, *positions_mm, pressure_frac=pressure_frac)
        return self.pipeline.drive(self.t_ns, LinkTiming(LINK_NS))

    def hold(self, reports: int, *positions_mm: tuple[float, float]) -> list[Tick]:
        return [self.report(*positions_mm) for _ in range(reports)]


def felt_um(modal_um: Phasors, at_mm: tuple[float, float]) -> float:
    return abs(PLATE.evaluate([at_mm])[0] @ np.array(modal_um))


def amplitude_um(tick: Tick, knot: int, at_mm: tuple[float, float]) -> float:
    return felt_um(tick.drive.knots[knot].modal_um, at_mm)


SLIPPERY, STICKY = (-30.2, 5.1), (21.3, -14.9)
ONE, STILL = Amplitude(1.0), Amplitude(0.0)
LEFT_HALF = Polygon(((-100.0, -100.0), (0.0, -100.0), (0.0, 100.0), (-100.0, 100.0)))


def contact_grams(modes: ModeShapes, points_mm: npt.ArrayLike, radius_mm: float) -> FloatArray:
    """Return G (N, M, M) of discs of `radius_mm` about `points_mm` (N, 2), for `solve(..., gram=)`."""
    points, disc = np.asarray(points_mm, np.float64), np.array(disc_points(radius_mm))
    shapes = modes.evaluate((points[:, None] + disc[:, :2]).reshape(-1, 2)).reshape(len(points), len(disc), modes.M)
    return np.asarray(np.einsum("nqk,q,nql->nkl", shapes, disc[:, 2], shapes))
