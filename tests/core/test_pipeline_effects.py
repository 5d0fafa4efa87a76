"""What a finger gets from effects: their form on the plate, who feels them, from which cause, and nothing else."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pipeline_bench import (
    FOREVER_NS,
    LEFT_HALF,
    LINK_NS,
    MS,
    ONE,
    PERIOD_NS,
    SLIPPERY,
    START_NS,
    STICKY,
    STILL,
    Bench,
    felt_um,
)

from hapticd.core.targets.effects import MAX_EFFECTS, MAX_PLAYING
from hapticd.values import LimitReason, SafeDrive, Tick
from hapticd_contract.contents import Amplitude, Content
from hapticd_contract.effects import (
    At,
    Effect,
    Envelope,
    Form,
    Modulation,
    Now,
    OnCrossing,
    OnEntering,
    OnLanding,
    OnLeaving,
    OnLifting,
    OnPressure,
    Pulse,
)
from hapticd_contract.states import EventKind, PlateEvent
from hapticd_contract.surfaces import Circle, Polygon, Surface
from hapticd_contract.targets import ClientTargets

WAVES = st.sampled_from(["sine", "square"])
CLICK = Pulse(1.0, 0.02, 0.002)


class Player(Bench):
    """A bench that keeps what was played and what happened."""

    def __init__(self, **settings: object) -> None:
        super().__init__(**settings)
        self.drives: list[SafeDrive] = []
        self.events: list[PlateEvent] = []
        self.refused: tuple[str, ...] = ()

    def lay(
        self,
        effects: dict[str, Effect],
        surfaces: dict[str, Surface] | None = None,
        client: str = "test",
        targets: dict[int | str, Content] | None = None,
        ttl_ns: int = FOREVER_NS,
    ) -> None:
        message = ClientTargets.of(client, ttl_ns, targets or {}, {}, None, surfaces or {}, effects)
        self.refused = self.scene.set_targets(message, self.t_ns)

    def play(self, reports: int, *positions_mm: tuple[float, float], pressure_frac: float = 0.2) -> None:
        for _ in range(reports):
            self.press(*positions_mm, pressure_frac=pressure_frac)

    def press(self, *positions_mm: tuple[float, float], pressure_frac: float = 0.2) -> Tick:
        tick = self.report(*positions_mm, pressure_frac=pressure_frac)
        if tick.drive is not None:
            self.drives.append(tick.drive)
        self.events += self.pipeline.events.take()
        return tick

    def kinds(self, *kinds: EventKind) -> list[EventKind]:
        return [event.kind for event in self.events if not kinds or event.kind in kinds]

    def the(self, kind: EventKind) -> PlateEvent:
        (event,) = [event for event in self.events if event.kind is kind]
        return event

    def played_um(self, t_ns: int, at_mm: tuple[float, float]) -> float:
        """The amplitude at a place as the board plays the frames: each from its beginning to the next one's."""
        drive = [one for one in self.drives if one.t_apply_ns <= t_ns][-1]
        since_ns = t_ns - drive.t_apply_ns
        left = [knot for knot in drive.knots if knot.dt_ns <= since_ns][-1]
        right = next((knot for knot in drive.knots if knot.dt_ns > since_ns), left)
        share = (since_ns - left.dt_ns) / max(right.dt_ns - left.dt_ns, 1)
        ends = zip(left.modal_um, right.modal_um, strict=True)
        return felt_um([before + (after - before) * share for before, after in ends], at_mm)


@pytest.fixture
def player() -> Player:
    return Player()


def begun_ns(player: Player) -> int:
    (one,) = player.scene.effects.playing
    return one.begin_ns


# --- the form on the plate --------------------------------------------------------------------------------------


def test_a_pulse_has_knots_at_its_corners_from_the_first_frame_after_its_message(player: Player) -> None:
    player.play(6, SLIPPERY)
    player.lay({"click": Effect.of(Pulse(1.0, 0.03, 0.002))})
    drive = player.press(SLIPPERY).drive
    begin_ns = begun_ns(player)
    assert 0 <= begin_ns - drive.t_apply_ns < 4000
    assert begin_ns + 2 * MS in [drive.t_apply_ns + knot.dt_ns for knot in drive.knots]
    player.play(4, SLIPPERY)
    for t_ms, um in ((0, 0.0), (1, 0.5), (2, 1.0), (15, 1.0), (28, 1.0), (29, 0.5), (30, 0.0), (35, 0.0)):
        assert player.played_um(begin_ns + t_ms * MS, SLIPPERY) == pytest.approx(um, abs=1e-3), t_ms
    assert player.kinds() == [EventKind.LANDED, EventKind.BEGUN, EventKind.ENDED]


@pytest.mark.parametrize("frequency_hz", [30.0, 80.0, 173.0, 250.0])
@pytest.mark.parametrize("wave", ["sine", "square"])
def test_a_modulation_is_within_three_percent_of_its_depth_at_every_instant(frequency_hz: float, wave: Any) -> None:
    player = Player()
    player.lay(
        {"hum": Effect.of(Modulation(frequency_hz, 0.8, wave), on="plate")}, {"plate": Surface.of(Amplitude(1.5))}
    )
    player.play(20, SLIPPERY)
    begin_ns, period_ns = begun_ns(player), round(1e9 / frequency_hz / 4000) * 4000
    for step in range(4000):
        t_ns = begin_ns + 60 * MS + step * 20_000
        phase = (t_ns - begin_ns) % period_ns / period_ns
        drawn = math.cos(2 * math.pi * phase) if wave == "sine" else 1.0 if phase <= 0.5 else -1.0
        if wave == "square" and min(abs(phase - 0.5), phase, 1 - phase) * period_ns < 5000:
            continue  # the step itself takes 4 us
        expected_um = 1.5 * (0.6 + 0.4 * drawn)
        assert player.played_um(t_ns, SLIPPERY) == pytest.approx(expected_um, abs=0.03 * 0.8 * 1.5)


# --- causes -----------------------------------------------------------------------------------------------------

TILE = {"left": Surface.of(ONE, LEFT_HALF)}


def test_a_landing_starts_an_effect_with_the_frame_of_its_first_report(player: Player) -> None:
    player.lay({"hello": Effect.of(CLICK, start=OnLanding())})
    tick = player.press(SLIPPERY)
    assert begun_ns(player) - tick.drive.t_apply_ns < 4000
    begun = player.the(EventKind.BEGUN)
    assert (begun.t_ns, begun.t_device_ns) == (player.t_ns - 10 * MS, player.t_ns - 10 * MS)
    assert (begun.client, begun.effect, begun.finger, (begun.x_mm, begun.y_mm)) == ("test", "hello", 1, SLIPPERY)
    player.play(8, SLIPPERY, STICKY)
    assert [event.finger for event in player.events if event.kind is EventKind.BEGUN] == [1, 2]


@pytest.mark.parametrize("speed_mm_s", [60.0, 150.0])
@pytest.mark.parametrize("cause", [OnEntering, OnLeaving, OnCrossing])
def test_an_edge_starts_an_effect_at_the_predicted_instant(cause: Any, speed_mm_s: float, player: Player) -> None:
    player.lay({"tick": Effect.of(CLICK, start=cause("left"))}, TILE)
    direction = 1.0 if cause is OnLeaving else -1.0
    for n in range(24):
        player.press((direction * (speed_mm_s * PERIOD_NS * 1e-9 * (n - 12)), 5.1))
    begun, crossed = player.the(EventKind.BEGUN), player.the(EventKind.CROSSED)
    assert begun.t_ns == crossed.t_ns
    # The finger is where its report says 10 ms before the report is read.
    true_ns = player.t_ns - 11 * PERIOD_NS - 10 * MS
    assert abs(begun.t_ns - true_ns) < 3 * MS
    assert player.kinds(EventKind.ENTERED, EventKind.LEFT)[-1] is (
        EventKind.LEFT if cause is OnLeaving else EventKind.ENTERED
    )


def test_a_strip_that_is_crossed_within_one_frame_is_entered_and_left(player: Player) -> None:
    strip = Surface.of(STILL, Polygon(((-1.0, -90.0), (1.0, -90.0), (1.0, 90.0), (-1.0, 90.0))))
    player.lay({"detent": Effect.of(CLICK, start=OnEntering(surface="strip"))}, {"strip": strip})
    for n in range(24):
        player.press((400.0 * PERIOD_NS * 1e-9 * (n - 12), 5.1))
    assert player.kinds()[1:] == [
        *(EventKind.CROSSED, EventKind.ENTERED, EventKind.BEGUN, EventKind.CROSSED, EventKind.LEFT, EventKind.ENDED)
    ]


def test_a_surface_that_appears_or_moves_under_a_finger_is_entered_not_crossed(player: Player) -> None:
    player.play(6, SLIPPERY)
    player.lay({}, {"disc": Surface.of(ONE, Circle(5.0), SLIPPERY)})
    player.play(3, SLIPPERY)
    player.lay({}, {"disc": Surface.of(STILL, Circle(5.0), SLIPPERY)})  # other content: it stays on it
    player.play(3, SLIPPERY)
    player.lay({}, {"disc": Surface.of(STILL, Circle(5.0), STICKY)})
    player.play(3, SLIPPERY)
    assert player.kinds() == [EventKind.LANDED, EventKind.ENTERED, EventKind.LEFT]


BUTTON = OnPressure(threshold=0.5, release=0.3)


def test_a_button_clicks_once_per_press_with_hysteresis(player: Player) -> None:
    player.lay({"click": Effect.of(CLICK, on="left", start=BUTTON)}, TILE)
    for pressure_frac in (0.1, 0.4, 0.5, 0.6, 0.4, 0.6, 0.31, 0.3, 0.45, 0.55):
        player.press(SLIPPERY, STICKY, pressure_frac=pressure_frac)
    assert [(event.kind, event.finger) for event in player.events if event.effect and event.finger] == [
        (EventKind.PRESSED, 1),
        (EventKind.BEGUN, 1),
        (EventKind.ENDED, 1),
        (EventKind.RELEASED, 1),
        (EventKind.PRESSED, 1),
        (EventKind.BEGUN, 1),
    ]


def test_a_finger_that_pressed_before_it_was_on_the_button_does_not_click(player: Player) -> None:
    player.play(3, SLIPPERY, pressure_frac=0.8)
    player.lay({"click": Effect.of(CLICK, on="left", start=BUTTON)}, TILE)
    player.play(3, SLIPPERY, pressure_frac=0.8)
    player.play(1)
    for x_mm in range(20, -30, -2):
        player.press((x_mm, 5.1), pressure_frac=0.8)
    assert player.kinds(EventKind.PRESSED, EventKind.RELEASED, EventKind.BEGUN) == []
    player.press((-30.0, 5.1), pressure_frac=0.3)
    player.press((-30.0, 5.1), pressure_frac=0.6)
    assert player.kinds(EventKind.PRESSED, EventKind.RELEASED, EventKind.BEGUN) == [EventKind.PRESSED, EventKind.BEGUN]


def test_a_loop_ends_when_its_cause_is_undone() -> None:
    for start, undo in (
        (OnLanding(), lambda player: player.play(1, STICKY)),
        (BUTTON, lambda player: player.play(1, SLIPPERY, pressure_frac=0.1)),
        (OnEntering(surface="disc"), lambda player: player.play(4, (-15.0, 5.1), pressure_frac=0.6)),
    ):
        player = Player()
        player.lay(
            {"hum": Effect.of(Modulation(40.0, 1.0), start=start)}, {"disc": Surface.of(ONE, Circle(5.0), SLIPPERY)}
        )
        player.play(1, STICKY)
        player.play(5, SLIPPERY, pressure_frac=0.6)
        finger_id = player.scene.effects.playing[-1].finger_id
        undo(player)
        assert finger_id not in [one.finger_id for one in player.scene.effects.playing], start


def test_an_effect_at_an_instant_begins_there_and_a_late_one_plays_its_rest(player: Player) -> None:
    player.play(6, SLIPPERY)
    ahead_ns, late_ns = player.t_ns + 60 * MS, player.t_ns - 100 * MS
    ramp = Envelope(((0.0, 0.0), (0.2, 2.0)))
    player.lay(
        {
            "soon": Effect.of(ramp, start=At(t_ns=ahead_ns)),
            "gone": Effect.of(ramp, start=At(t_ns=late_ns - 200 * MS)),
        }
    )
    player.play(9, SLIPPERY)
    assert player.played_um(ahead_ns - MS, SLIPPERY) == 0.0
    assert player.played_um(ahead_ns + 30 * MS, SLIPPERY) == pytest.approx(0.3, abs=1e-3)
    assert player.the(EventKind.BEGUN).t_ns == ahead_ns
    other = Player()
    other.play(6, SLIPPERY)
    other.lay({"late": Effect.of(ramp, start=At(t_ns=late_ns))})
    other.play(1, SLIPPERY)
    assert other.played_um(late_ns + 130 * MS, SLIPPERY) == pytest.approx(1.3, abs=0.01)


# --- once, again, and at an end ---------------------------------------------------------------------------------


def test_a_refreshed_message_does_not_start_an_effect_again_and_another_id_does(player: Player) -> None:
    for start_id, begun in ((1, 1), (1, 1), (2, 2), (2, 2)):
        player.lay({"click": Effect.of(CLICK, start=Now(id=start_id))})
        player.play(5, SLIPPERY)
        assert player.scene.effects.begun == begun


def test_an_effect_ends_with_its_surface_even_if_a_message_repeats_the_effect() -> None:
    player, start = Player(), OnEntering(surface="tile")
    effects = {"buzz": Effect.of(CLICK, start=start, loops=True)}
    player.lay(effects, surfaces={"tile": Surface.of(Amplitude(0.5))})
    player.play(10, SLIPPERY)
    assert len(player.scene.effects.playing) == 1
    player.lay(effects, surfaces={"tile": Surface.of(Amplitude(999.0))})
    assert player.refused[1] == "effect 'buzz' names surface 'tile', which was refused."
    player.play(10, SLIPPERY)
    assert player.scene.effects.playing == []
    assert player.played_um(player.t_ns, SLIPPERY) == 0.0


def test_a_stopped_or_expired_effect_ends_with_the_next_frame() -> None:
    for end in (
        lambda player: player.lay({}, {"plate": Surface.of(ONE)}),
        lambda player: player.scene.release_client("test"),
        lambda player: setattr(player, "t_ns", player.t_ns + 2_000 * MS),
    ):
        player = Player()
        player.lay({"up": Effect.of(Pulse(1.0, 30.0))}, {"plate": Surface.of(ONE)}, ttl_ns=2_000 * MS)
        player.play(6, SLIPPERY)
        assert player.played_um(player.t_ns, SLIPPERY) == pytest.approx(2.0, abs=1e-3)
        end(player)
        player.play(2, SLIPPERY)
        assert player.scene.effects.playing == []
        assert player.played_um(player.t_ns + LINK_NS, SLIPPERY) <= 1.0 + 1e-9


def test_an_effect_is_felt_by_its_client_s_and_free_fingers_only(player: Player) -> None:
    player.play(6, SLIPPERY, STICKY, (0.5, 40.0))
    player.lay({}, client="other", targets={2: STILL})
    player.lay({"up": Effect.of(Pulse(1.0, 1.0)), "mine": Effect.of(Pulse(1.0, 1.0), on=2)}, targets={1: ONE})
    assert player.refused == (
        "effect 'mine' is on finger 2, which is held by 'other': wait until that client releases it.",
    )
    player.play(2, SLIPPERY, STICKY, (0.5, 40.0))
    tick = player.press(SLIPPERY, STICKY, (0.5, 40.0))
    assert [round(point.target_um, 6) for point in tick.points] == [2.0, 0.0, 1.0]


def test_an_effect_on_a_surface_is_felt_on_it_and_one_on_a_finger_by_that_finger() -> None:
    for on, targets_um in (("left", [1.5, 0.0]), (2, [1.0, 0.5])):
        player = Player()
        player.play(3, SLIPPERY, STICKY)
        player.lay({"up": Effect.of(Pulse(0.5, 1.0), on=on)}, TILE)
        player.play(2, SLIPPERY, STICKY)
        assert [point.target_um for point in player.press(SLIPPERY, STICKY).points] == targets_um


# --- what it costs ----------------------------------------------------------------------------------------------


def test_nothing_is_computed_while_no_effect_plays_and_a_standing_reference_stands() -> None:
    plain, armed = Player(), Player()
    plain.lay({}, TILE)
    armed.lay({"a": Effect.of(CLICK, start=OnLifting()), "b": Effect.of(CLICK, start=BUTTON)}, TILE)
    of_plain, of_armed = ([player.press(SLIPPERY) for _ in range(20)] for player in (plain, armed))
    assert of_plain == of_armed
    assert plain.pipeline.counters == armed.pipeline.counters
    assert plain.pipeline.counters.skipped_standing > 5


@pytest.mark.parametrize(
    ("form", "sentence"),
    [
        (Pulse(9.0, 0.1), "effect 'x' cannot have 9 um: ask for at most 4 um."),
        (Envelope(((0.0, 0.0), (1.0, -5.0))), "effect 'x' cannot have 5 um: ask for at most 4 um."),
        (
            Modulation(290.0, 1.0),
            "effect 'x' needs 26 knots in 12.5 ms, a frame on this link has 22: a sine has at most 252 Hz.",
        ),
        (
            Envelope(tuple((0.0004 * n, 0.01 * n) for n in range(200))),
            "effect 'x' needs 33 knots in 12.5 ms, a frame on this link has 22: make it 11 corners less dense.",
        ),
    ],
)
def test_what_a_frame_or_the_plate_cannot_carry_is_refused_with_the_reason(form: Form, sentence: str) -> None:
    player = Player()
    player.lay({"x": Effect.of(form), "good": Effect.of(CLICK)})
    assert player.refused == (sentence,)
    assert [held.name for held in player.scene.effects.held] == ["good"]


def test_two_waves_that_do_not_fit_into_one_frame_do_not_play_at_once(player: Player) -> None:
    player.lay({name: Effect.of(Modulation(150.0, 0.5)) for name in ("first", "second")})
    player.play(3, SLIPPERY)
    assert [one.held.name for one in player.scene.effects.playing] == ["first"]
    assert (player.scene.effects.begun, player.scene.effects.skipped) == (1, 1)


def test_effects_in_all_and_those_that_play_are_bounded(player: Player) -> None:
    for n in range(5):
        player.lay({f"{k}": Effect.of(CLICK, start=OnLanding()) for k in range(16)}, client=f"c{n}")
    assert f"{MAX_EFFECTS} effects" in player.refused[0]
    assert len(player.scene.effects.held) == MAX_EFFECTS
    tick = player.press(SLIPPERY, STICKY)
    assert len(player.scene.effects.playing) == MAX_PLAYING
    assert len(tick.drive.knots) <= 24


def test_a_finger_that_trembles_on_an_edge_starts_an_effect_at_most_every_10_ms(player: Player) -> None:
    player.lay({"tick": Effect.of(CLICK, start=OnCrossing(surface="left"))}, TILE)
    for n in range(100):
        player.press((0.3 * (-1) ** n, 5.1))
    assert player.scene.effects.begun <= 100 * PERIOD_NS // (10 * MS) + 1
    assert len(player.scene.effects.playing) <= 1


def test_an_effect_that_is_started_a_thousand_times_a_second_begins_once_per_pass(player: Player) -> None:
    player.play(3, SLIPPERY)
    before = player.scene.effects.begun
    for _ in range(10):
        for start_id in range(12):
            player.lay({"click": Effect.of(CLICK, start=Now(id=player.t_ns + start_id))})
        player.play(1, SLIPPERY)
    assert player.scene.effects.begun == before + 10
    assert len(player.scene.effects.playing) == 1


# --- anything ---------------------------------------------------------------------------------------------------

numbers = st.floats(-3.0, 3.0)
any_form = st.one_of(
    st.builds(Pulse, numbers, st.sampled_from([0.001, 0.02, 0.3]), st.sampled_from([0.0, 0.0005])),
    st.builds(Modulation, st.floats(1.0, 250.0), st.floats(0, 1), WAVES, st.sampled_from([0.001, 0.05])),
    st.builds(Modulation, st.floats(1.0, 100.0), st.floats(0, 1), WAVES, st.none()),
    st.lists(st.tuples(st.floats(0.0, 0.03), st.floats(0.0, 3.0)), max_size=6).map(
        lambda points: Envelope(((0.0, 1.0), *sorted(points), (0.04, 2.0)), is_factor=True)
    ),
)
names = st.sampled_from(["disc", "left", "gone"])
any_start = st.one_of(
    st.builds(Now, st.integers(0, 2)) | st.just(OnLanding()) | st.just(OnLifting()),
    st.builds(OnEntering, names) | st.builds(OnLeaving, names) | st.builds(OnCrossing, names),
    st.builds(
        lambda threshold_frac: OnPressure(threshold=threshold_frac, release=0.5 * threshold_frac),
        st.floats(0.1, 0.9),
    ),
    st.builds(lambda ms: At(t_ns=START_NS + ms * MS), st.integers(-100, 600)),
)
any_effect = st.builds(
    Effect.of, any_form, st.sampled_from([None, 1, 2, "disc", "left", "gone"]), any_start, loops=st.booleans()
)
any_surface = st.builds(
    Surface.of,
    st.sampled_from([ONE, STILL]),
    st.sampled_from([Circle(8.0), LEFT_HALF, None]),
    st.tuples(st.floats(-40, 40), st.floats(-40, 40)),
    velocity_mm_s=st.tuples(st.floats(-900, 900), st.floats(-900, 900)),
    turning_rad_s=st.floats(-60, 60),
)
any_place = st.tuples(st.floats(-60, 60), st.floats(-60, 60))
any_step = st.tuples(
    st.none() | st.dictionaries(st.sampled_from("abcd"), any_effect, max_size=4),
    st.dictionaries(st.sampled_from(["disc", "left"]), any_surface),
    st.lists(any_place, max_size=3),
    st.floats(0, 1),
    st.integers(1, 3),
)


@given(st.lists(any_step, max_size=12))
@settings(max_examples=25)
def test_for_any_fingers_and_clients_frames_are_sound_and_events_in_order(steps: list[Any]) -> None:
    player = Player()
    for effects, surfaces, places, pressure_frac, reports in steps:
        if effects is not None:
            player.lay(effects, surfaces, ttl_ns=60 * MS)
        player.play(reports, *places, pressure_frac=pressure_frac)
    for drive in player.drives:
        assert drive.reasons is LimitReason.NONE
        dt_ns = [knot.dt_ns for knot in drive.knots]
        assert dt_ns == sorted(set(dt_ns))
        assert 1 <= len(dt_ns) <= 24
        assert all(abs(w_um) <= 4.0 for knot in drive.knots for w_um in knot.modal_um)
    assert [event.seq for event in player.events] == list(range(1, len(player.events) + 1))
    begun = [event.effect for event in player.events if event.kind is EventKind.BEGUN]
    ended = [event.effect for event in player.events if event.kind is EventKind.ENDED]
    assert len(ended) + len(player.scene.effects.playing) <= len(begun)
    for finger_id in {event.finger for event in player.events}:
        mine = [event for event in player.events if event.finger == finger_id]
        for name in ("disc", "left"):
            ins = [event.kind for event in mine if event.surface == name and event.kind is not EventKind.CROSSED]
            assert ins == [EventKind.ENTERED, EventKind.LEFT] * (len(ins) // 2) + [EventKind.ENTERED] * (len(ins) % 2)
