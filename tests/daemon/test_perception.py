"""What a person perceives, as telemetry and recordings report it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, cast

import msgpack
import numpy as np
import pytest
from machine_bench import PLATE, SLIPPERY, STICKY, Bench

from hapticd.board_protocol import BoardState
from hapticd.core.board.session import BoardSession
from hapticd.core.frame import PlayedReference
from hapticd.core.friction import FrictionCurve
from hapticd.core.perception import ContactPerception
from hapticd.core.pipeline import Pipeline
from hapticd.core.plate.contact import ContactEllipse
from hapticd.core.uncertainty import CERTAIN, Uncertainty
from hapticd.daemon.perception import BIN_JND, ErrorTally, Perception
from hapticd.files.recording.kinds import record_of
from hapticd.values import Finger, Tick, TouchPoint
from hapticd_contract.states import Perceived

MS = 1_000_000
CURVE = FrictionCurve.from_amplitudes((0.0, 1.0, 3.0), floor_frac=0.2)  # 1 um: 0.6 of bare glass's friction
CREST_MM = 27.0 / 4.0  # where mode X of the bench's plate is 1


class Given:
    """A pipeline whose fingers rest on a crest of mode X, with these targets; None for a finger without one."""

    def __init__(self, *targets_um: float | None) -> None:
        self.modes = PLATE
        self.modal_um: tuple[complex, ...] = (1.0, 0.0)
        self.targets_um = dict(enumerate(targets_um, 1))
        self.fingers = tuple(Finger(n, n, CREST_MM, 0.0, False) for n in self.targets_um)
        self.asked_ns: list[int] = []
        self.ellipses: list[ContactEllipse | None] | None = None
        self.status: Any = None
        self.clock: Any = None

    def past(self, keys: Sequence[int], t_ns: int) -> PlayedReference:
        self.asked_ns.append(t_ns)
        places = [(CREST_MM, 0.0, self.targets_um[key] or 0.0) for key in keys]
        return PlayedReference(self.modal_um, places, [1.0] * len(keys), self.ellipses)

    def asked_um(self, _: int) -> tuple[complex, ...]:
        return self.modal_um

    def motions(self, keys: Sequence[int], _: int) -> list[tuple[float, float]]:
        return [(0.0, 0.0)] * len(keys)

    def tick(self, t_ms: int) -> Tick:
        points = [
            TouchPoint(key, CREST_MM, 0.0, um, um, CREST_MM, 0.0)
            for key, um in self.targets_um.items()
            if um is not None
        ]
        return Tick(t_ms * MS, 10 * MS, 15 * MS, None, tuple(points), False)


def perception_of(given: Given, *, has_contacts: bool = True, expected: Uncertainty = CERTAIN) -> Perception:
    contacts = ContactPerception(CURVE, 0.0, expected)
    return Perception(cast(Pipeline, given), cast(BoardSession, given), contacts, contacts, has_contacts=has_contacts)


def test_a_finger_s_friction_is_that_of_the_plate_relative_to_what_was_asked() -> None:
    given = Given(0.0, 1.0, 3.0)
    perceived = perception_of(given).judge(given.tick(0))[1]
    assert [perceived[n].felt_friction for n in (1, 2, 3)] == pytest.approx([0.5] * 3, abs=1e-3)
    assert [perceived[n].friction_change for n in (1, 2, 3)] == pytest.approx([-0.4, 0.0, 2.0], abs=1e-3)
    assert [perceived[n].error_jnd for n in (1, 2, 3)] == pytest.approx([-0.4 / 0.11, 0.0, 2.0 / 0.11], abs=0.01)


def test_a_finger_without_a_target_feels_the_plate_but_nothing_was_asked_for_it() -> None:
    given = Given(None)
    (perceived,) = perception_of(given).judge(given.tick(0))[1].values()
    assert perceived.felt_friction == pytest.approx(0.5, abs=1e-3)
    assert perceived.contact_um == pytest.approx(1.0, abs=1e-3)
    assert (perceived.friction_change, perceived.felt_frac, perceived.error_jnd) == (None, None, None)


def test_errors_over_time_begin_again_with_each_touch() -> None:
    given = Given(0.0)
    perception = perception_of(given)
    found = []
    for t_ms, reference_um in ((0, 1.0), (10, 0.0), (40, 0.0)):
        given.modal_um = (reference_um, 0.0)
        found.append(perception.judge(given.tick(t_ms))[1][1])
    perception.judge(Given().tick(50))
    found.append(perception.judge(given.tick(60))[1][1])
    assert [one.felt_frac for one in found] == pytest.approx([0.0, 0.0, 0.75, 1.0], abs=1e-6)
    assert found[2].bias_jnd == pytest.approx(-0.25 * 0.4 / 0.11, abs=0.01)
    assert (found[2].median_jnd, found[2].error_95_jnd) == pytest.approx((0.0, 0.4 / 0.11), abs=0.05)
    assert [one.within_two_frac for one in found] == [one.felt_frac for one in found]


def test_figures_over_time_are_those_of_all_errors_so_far_sorted() -> None:
    generator = np.random.default_rng(1)
    errors_jnd, spans_ns = generator.normal(0.5, 2.0, 300), generator.integers(1, 30, 300)
    tally, repeated_jnd = ErrorTally(2.5), np.array([2.5])
    for error_jnd, span_ns in zip(errors_jnd.tolist(), spans_ns.tolist(), strict=True):
        tally.add(error_jnd, span_ns)
        repeated_jnd = np.append(repeated_jnd, [error_jnd] * span_ns)
        sizes_jnd, found = np.abs(repeated_jnd), tally.figures()
        quantiles_jnd = np.quantile(sizes_jnd, (0.5, 0.95), method="inverted_cdf")
        assert [found["median_jnd"], found["error_95_jnd"]] == pytest.approx(quantiles_jnd, abs=0.51 * BIN_JND)
        means = repeated_jnd.mean(), (sizes_jnd < 1.0).mean(), (sizes_jnd < 2.0).mean()
        assert [found[name] for name in ("bias_jnd", "felt_frac", "within_two_frac")] == pytest.approx(means)


@pytest.mark.parametrize(
    ("asked_um", "gets_um", "misses"),
    [(1.0, 1.0, False), (1.0, 0.85, True), (1.0, 1.3, True), (0.0, 0.1, False), (0.0, 0.5, True)],
)
def test_a_finger_that_gets_less_or_feels_a_difference_misses_its_target(
    asked_um: float, gets_um: float, misses: bool
) -> None:
    given = Given(asked_um)
    given.modal_um = (gets_um, 0.0)
    for has_contacts in (True, False):
        perceived = perception_of(given, has_contacts=has_contacts).judge(given.tick(0))[1][1]
        assert perceived.misses_target is misses


def test_what_is_not_known_is_expected_of_the_pass_s_amplitudes_too() -> None:
    given = Given(0.0, 1.0)
    tick, perceived = perception_of(given, expected=Uncertainty(map_frac=0.1)).judge(given.tick(0))
    for point in tick.points:
        one = perceived[point.key]  # type: ignore[index]
        assert point.achieved_um == pytest.approx(math.hypot(1.0, 0.1), abs=1e-3)
        assert one.achieved_um_low is not None
        assert one.achieved_um_high is not None
        assert one.achieved_um_low < point.achieved_um < one.achieved_um_high


def test_how_persons_differ_makes_frictions_and_errors_unsure_but_no_amplitude() -> None:
    given = Given(1.0)
    one = perception_of(given, expected=Uncertainty(curve_frac=0.1)).judge(given.tick(0))[1][1]
    frictions = [CURVE.friction(1.0 + share) for share in (0.1645, 0.0, -0.1645)]
    said = [one.felt_friction_low, one.felt_friction, one.felt_friction_high]
    assert said == pytest.approx([CURVE.friction_frac(friction) for friction in frictions], abs=1e-3)
    errors_jnd = [(friction / 0.6 - 1.0) / 0.11 for friction in frictions]
    assert [one.error_jnd_low, one.error_jnd, one.error_jnd_high] == pytest.approx(errors_jnd, abs=0.01)
    assert one.contact_um_low == pytest.approx(one.contact_um_high)


def test_an_ellipse_is_reported_with_its_axes_and_amplitudes_count_over_it() -> None:
    """Along x, across the waves of mode X, more of it is off the crest than along y."""
    turned_rad, cosine, sine = 0.4, math.cos(0.4), math.sin(0.4)
    given = Given(1.0, 1.0, 1.0, 1.0)
    turned = (5.5 * cosine**2 + 4.0 * sine**2, 1.5 * cosine * sine, 5.5 * sine**2 + 4.0 * cosine**2)
    given.ellipses = [(5.5, 0.0, 4.0), (4.0, 0.0, 5.5), turned, None]
    tick, perceived = perception_of(given).judge(given.tick(0))
    along, across, oblique, point = [perceived[key] for key in (1, 2, 3, 4)]
    axes = [(one.contact_major_mm, one.contact_minor_mm, one.contact_angle_rad) for one in perceived.values()]
    assert axes[0] == pytest.approx((11.0, 8.0, 0.0))
    assert axes[1] == pytest.approx((11.0, 8.0, math.pi / 2.0))
    assert axes[2] == pytest.approx((11.0, 8.0, turned_rad))
    assert axes[3] == (None, None, None)
    achieved_um = [point.achieved_um for point in tick.points]
    for said in (
        [one.contact_um or 0.0 for one in (along, oblique, across, point)],
        [achieved_um[n] for n in (0, 2, 1, 3)],
    ):
        assert said == sorted(said)
        assert said[0] < 0.95 * said[2] < 0.95 * said[3]


def test_the_pad_s_report_of_a_contact_is_published_with_and_without_a_target() -> None:
    given = Given(1.0, None, 0.0)
    ellipse = {"pressure_frac": 0.4, "major_mm": 10.0, "minor_mm": 8.0}
    given.fingers = (*(finger._replace(**ellipse) for finger in given.fingers[:2]), given.fingers[2])
    perceived = perception_of(given).judge(given.tick(0))[1]
    assert [perceived[n].pressure_frac for n in (1, 2, 3)] == [0.4, 0.4, 0.0]
    assert [perceived[n].area_mm2 for n in (1, 2, 3)] == [pytest.approx(20.0 * math.pi)] * 2 + [None]


@pytest.mark.parametrize(
    ("saturated", "ago_ms", "contact_um"), [(True, 5, 1.0 - 0.8 * 0.64 / 0.8), (False, 5, 1.0), (True, 60, 1.0)]
)
def test_where_the_voltage_ends_what_the_sensors_read_counts(saturated: bool, ago_ms: int, contact_um: float) -> None:
    given = Given(1.0)
    given.status = SimpleNamespace(saturated=saturated, state=BoardState.LIVE, t_board_us=0, measured_um=(0.2, 0.0))
    given.clock = SimpleNamespace(ready=True, to_host_ns=lambda _, near: near - ago_ms * MS)
    perceived = perception_of(given).judge(given.tick(100))[1][1]
    assert perceived.contact_um == pytest.approx(contact_um, abs=1e-3)  # one reading errs too: it counts in part


def driven() -> tuple[dict[str, Any], dict[str, Any]]:
    """The newest pass of two fingers with targets, as a subscriber and a recording get it."""
    bench = Bench(SLIPPERY, STICKY).driven()
    sent: list[bytes] = []
    passes: list[tuple[Any, ...]] = []
    bench.machine.watch(sent.append, bench.t_ns)
    bench.machine.observer = lambda kind, _, *values: passes.append(values) if kind == "pass" else None
    bench.run(30)
    return msgpack.unpackb(sent[-1]), record_of("pass", 1, 0, passes[-1]).fields


def test_telemetry_and_recordings_report_the_same_friction_and_amplitude_of_contacts() -> None:
    state, recorded = driven()
    fingers = {finger["id"]: finger for finger in state["fingers"]}
    assert len(fingers) == len(recorded["points"]) == 2
    for point in recorded["points"]:
        finger = fingers[point["finger_id"]]
        assert math.isfinite(point["friction_change"])
        assert 0.0 <= point["felt_frac"] <= 1.0
        assert finger["error_jnd"] is None  # a plate of two modes is driven for points
        for name in Perceived.__struct_fields__:
            assert point.get(name) == finger[name]
    rms_um = [point["contact_um"] for point in sorted(recorded["points"], key=lambda point: point["target_um"])]
    assert 0.0 < rms_um[0] < rms_um[1]  # contact leak and contact slip


def test_a_pass_goes_on_and_is_reported_where_perception_fails(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    sent: list[bytes] = []
    bench.machine.watch(sent.append, bench.t_ns)
    monkeypatch.setattr(Perception, "_judged", lambda *_: 1 / 0)
    received = bench.run(100)
    assert "reference" in [each.name for each in received]
    assert len(msgpack.unpackb(sent[-1])["fingers"]) == 2
    assert sum("what fingers perceive" in record.getMessage() for record in caplog.records) == 1
