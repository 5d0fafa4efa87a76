"""What a finger should feel at a place: finite, within its bounds, and where the client drew it."""

from __future__ import annotations

import math
import sys

import mpmath
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.core.targets.textures.noise import MOST_RMS
from hapticd.core.targets.textures.registry import amplitude, detail, found, highest_um, refusal
from hapticd_contract.contents import Amplitude, Content, Friction, Gradient, Grating, LevelMap, Noise

PLATE_MM = (137.5, 100.0)
CURVE = DEFAULT_FRICTION_CURVE

any_finite = st.floats(allow_nan=False, allow_infinity=False)
on_plate = st.floats(-70, 70)
um = st.floats(0, 1000)
gratings = st.builds(Grating, st.floats(0.1, 1000), um, um, st.floats(-6.3, 6.3), st.just(0.0) | st.floats(0, 1))


@st.composite
def maps(draw: st.DrawFn) -> LevelMap:
    width, height = draw(st.integers(1, 6)), draw(st.integers(1, 6))
    levels = draw(st.binary(min_size=width * height, max_size=width * height))
    return LevelMap(width, height, levels, draw(um), draw(um))


friction_maps = st.builds(replace, maps(), friction=st.tuples(st.floats(0, 1), st.floats(0, 1)))
gradients = st.builds(Gradient, st.floats(0.1, 1000), um, um, st.floats(-6.3, 6.3))


@st.composite
def noises(draw: st.DrawFn) -> Noise:
    shortest_mm = draw(st.floats(0.1, 1000))
    longest_mm = draw(st.floats(shortest_mm, 1000))
    return Noise(
        seed=draw(st.integers(0, 2**32 - 1)),
        shortest_mm=shortest_mm,
        longest_mm=longest_mm,
        exponent=draw(st.floats(0, 4)),
        mean_um=draw(um),
        rms_um=draw(um),
    )


# --- every target -----------------------------------------------------------------------------------------------


@given(
    gratings
    | maps()
    | friction_maps
    | gradients
    | noises()
    | st.builds(Amplitude, um)
    | st.builds(Friction, st.floats(0, 1)),
    any_finite,
    any_finite,
)
@settings(max_examples=400)
def test_a_texture_is_finite_and_between_its_amplitudes_everywhere(target: Content, x_mm: float, y_mm: float) -> None:
    amplitude_um = amplitude(target, CURVE, PLATE_MM)(x_mm, y_mm)
    highest = highest_um(target, CURVE)
    lowest = highest
    match target:
        case LevelMap(friction=(low, high)):
            lowest = CURVE.amplitude_um(max(low, high))
        case Grating() | LevelMap():
            lowest = min(target.low_um, target.high_um)
        case Gradient():
            lowest = min(target.from_um, target.to_um)
        case Noise():
            lowest = max(target.mean_um - MOST_RMS * target.rms_um, 0.0)
    rounding_um = max(1e-12 * highest, sys.float_info.min)  # halves of the least number are 0
    assert lowest - rounding_um <= amplitude_um <= highest + rounding_um
    assert amplitude_um >= 0.0  # the solver refuses less, however little


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (-math.inf, math.inf)])
@pytest.mark.parametrize(
    "target",
    [
        Grating(5.0, angle_rad=0.3, low_um=0.5, high_um=2.0, duty_frac=0.0),
        Grating(5.0, angle_rad=0.3, low_um=0.5, high_um=2.0, duty_frac=0.5),
        LevelMap(2, 2, b"\x00\x40\x80\xff", 0.5, 2.0),
        Gradient(5.0, angle_rad=0.3, from_um=0.5, to_um=2.0),
        Noise(seed=1, shortest_mm=1.0, longest_mm=9.0, exponent=0.5, mean_um=1.25, rms_um=0.25),
    ],
)
def test_no_position_at_all_is_harmless(target: Content, place: tuple[float, float]) -> None:
    assert 0.5 <= amplitude(target, CURVE, PLATE_MM)(*place) <= 2.0


@pytest.mark.parametrize(("name", "why"), [("checkers", "textures.checkers"), ("noise", "the Texture of Grating")])
def test_a_target_whose_texture_is_missing_stops_the_import(name: str, why: str) -> None:
    with pytest.raises(ImportError, match=why):
        found({Grating: name})


# --- gratings ---------------------------------------------------------------------------------------------------


@given(st.floats(0.5, 50), st.floats(-6.3, 6.3), on_plate, on_plate)
def test_a_sine_grating_is_the_sine_to_the_last_digits(
    period_mm: float, angle: float, x_mm: float, y_mm: float
) -> None:
    amplitude_um = amplitude(
        Grating(period_mm, angle_rad=angle, low_um=1.0, high_um=3.0, duty_frac=0.0), CURVE, PLATE_MM
    )(x_mm, y_mm)
    with mpmath.workdps(40):
        along = x_mm * mpmath.cos(angle) + y_mm * mpmath.sin(angle)
        exact = 2 + mpmath.cos(2 * mpmath.pi * along / mpmath.mpf(period_mm))
    assert amplitude_um == pytest.approx(float(exact), abs=1e-12 * 100 / period_mm + 1e-13)


@pytest.mark.parametrize("duty", [0.0, 0.25, 0.5, 1.0])
def test_a_grating_has_a_crest_through_the_plates_centre(duty: float) -> None:
    assert (
        amplitude(Grating(7.0, angle_rad=1.1, low_um=0.5, high_um=2.0, duty_frac=duty), CURVE, PLATE_MM)(0.0, 0.0)
        == 2.0
    )


@pytest.mark.parametrize("duty", [0.1, 0.5, 0.75])
def test_the_duty_is_the_share_of_the_period_that_is_high(duty: float) -> None:
    square = amplitude(Grating(4.0, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=duty), CURVE, PLATE_MM)
    samples = [square(-40.0 + 0.01 * n, 13.0) for n in range(8000)]
    assert set(samples) == {0.0, 1.0}
    assert sum(samples) / len(samples) == pytest.approx(duty, abs=0.006)  # a sample or two at each edge


@pytest.mark.parametrize("duty_frac", [5e-324, 1e-300, 1.0 - 2.0**-53])
def test_however_thin_a_stripe_its_detail_can_be_divided_by(duty_frac: float) -> None:
    finest_mm = detail(
        Grating(0.1, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=duty_frac), (137.5, 137.5)
    ).finest_mm
    assert finest_mm == 1e-3


# --- gradients and noise ----------------------------------------------------------------------------------------


def test_a_gradient_is_linear_along_its_angle_and_constant_beyond() -> None:
    upward = amplitude(Gradient(20.0, angle_rad=math.pi / 2, from_um=0.5, to_um=1.5), CURVE, PLATE_MM)
    places_mm = ((7.0, -60.0), (7.0, -10.0), (0.0, 0.0), (-7.0, 5.0), (0.0, 60.0))
    assert [upward(*place) for place in places_mm] == pytest.approx([0.5, 0.5, 1.0, 1.25, 1.5])


ROUGH = Noise(seed=7, shortest_mm=1.0, longest_mm=16.0, exponent=0.0, mean_um=1.5, rms_um=0.2)


def sampled(target: Noise) -> npt.NDArray[np.float64]:
    """The texture over 128 mm, four points per mm."""
    felt = amplitude(target, CURVE, PLATE_MM)
    return np.array([[felt(0.25 * column, 0.25 * row) for column in range(512)] for row in range(0, 512, 16)])


def test_noise_has_its_mean_and_its_rms_and_is_the_same_for_the_same_seed() -> None:
    um = sampled(ROUGH)
    assert um.mean() == pytest.approx(1.5, abs=0.01)
    assert um.std() == pytest.approx(0.2, rel=0.05)
    assert amplitude(ROUGH, CURVE, PLATE_MM)(3.0, -4.0) == pytest.approx(1.393110, abs=1e-6)  # on every machine
    assert amplitude(replace(ROUGH, seed=8), CURVE, PLATE_MM)(3.0, -4.0) != amplitude(ROUGH, CURVE, PLATE_MM)(3.0, -4.0)


@pytest.mark.parametrize(("exponent", "least"), [(0.0, 0.1), (1.0, 0.0)])
def test_noise_has_the_spectrum_that_it_is_given(exponent: float, least: float) -> None:
    um = sampled(replace(ROUGH, exponent=exponent)) - 1.5
    along_1_mm = np.fft.rfftfreq(512, 0.25)
    power = (np.abs(np.fft.rfft(um * np.hanning(512), axis=1)) ** 2).sum(axis=0)
    assert power[along_1_mm > 1.1].sum() < 0.003 * power.sum()  # nothing is shorter than 1 mm
    fine = power[along_1_mm > 0.25].sum() / power.sum()  # half of the octaves, seen obliquely
    assert (fine > least) if least else (fine < 0.05)


# --- maps -------------------------------------------------------------------------------------------------------


def test_a_map_of_frictions_is_bilinear_in_friction_and_at_most_the_plate_s_limit() -> None:
    image = LevelMap(2, 1, b"\x00\xff", 0.0, 0.0, friction=(1.0, 0.0))
    felt = amplitude(image, CURVE, PLATE_MM, w_limit_um=1.2)
    places_mm = [(share - 0.5) * PLATE_MM[0] for share in (0.0, 0.25, 0.5, 1.0)]
    expected_um = [min(CURVE.amplitude_um(friction), 1.2) for friction in (1.0, 0.75, 0.5, 0.0)]
    assert [felt(x_mm, 0.0) for x_mm in places_mm] == pytest.approx(expected_um, abs=2e-3)
    assert refusal(image, CURVE, 1.2) == ""


def test_a_maps_first_row_is_the_plates_far_edge_and_its_first_column_the_left() -> None:
    image = amplitude(LevelMap(2, 2, b"\x00\x33\x66\xff", 0.0, 255.0), CURVE, PLATE_MM)
    right, far = PLATE_MM[0] / 2, PLATE_MM[1] / 2
    assert [image(-right, far), image(right, far), image(-right, -far), image(right, -far)] == [0, 0x33, 0x66, 255]
    assert image(0.0, 0.0) == pytest.approx((0 + 0x33 + 0x66 + 255) / 4)


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 3), (3, 1), (4, 3)])
def test_a_map_gives_each_pixel_at_its_own_centre(width: int, height: int) -> None:
    levels = bytes((37 * n) % 256 for n in range(width * height))
    image = amplitude(LevelMap(width, height, levels, 0.0, 255.0), CURVE, PLATE_MM)
    for row in range(height):
        for column in range(width):
            x_mm = PLATE_MM[0] * (column / (width - 1) - 0.5) if width > 1 else 9.0
            y_mm = PLATE_MM[1] * (0.5 - row / (height - 1)) if height > 1 else 9.0
            assert image(x_mm, y_mm) == pytest.approx(levels[row * width + column])


@given(maps(), on_plate, on_plate, st.floats(-1e-6, 1e-6))
def test_a_map_has_no_steps(target: LevelMap, x_mm: float, y_mm: float, step_mm: float) -> None:
    image = amplitude(target, CURVE, PLATE_MM)
    steepest_um_per_mm = 6 / min(PLATE_MM) * abs(target.high_um - target.low_um)
    assert abs(image(x_mm + step_mm, y_mm) - image(x_mm, y_mm)) <= steepest_um_per_mm * abs(step_mm) + 1e-9
