"""What a finger should feel at a place: finite, within its bounds, and where the client drew it."""

from __future__ import annotations

import math
import sys

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.core.targets.textures import MOST_RMS, AmplitudeAt, Textures, finest_mm
from hapticd_contract.contents import Amplitude, Content, Friction, Gradient, Grating, LevelMap, Noise

PLATE_MM = (137.5, 100.0)
CURVE = DEFAULT_FRICTION_CURVE

um = st.floats(0, 1000)
gratings = st.builds(Grating, st.floats(0.1, 1000), um, um, st.floats(-6.3, 6.3), st.just(0.0) | st.floats(0, 1))
any_place = st.floats(allow_nan=False, allow_infinity=False)
maps = st.tuples(st.integers(1, 6), st.integers(1, 6)).flatmap(
    lambda size: st.builds(LevelMap, *map(st.just, size), st.binary(min_size=size[0] * size[1], max_size=36), um, um)
)
friction_maps = st.builds(replace, maps, friction=st.tuples(st.floats(0, 1), st.floats(0, 1)))
gradients = st.builds(Gradient, st.floats(0.1, 1000), um, um, st.floats(-6.3, 6.3))
noises = st.builds(
    Noise,
    seed=st.integers(0, 2**32 - 1),
    shortest_mm=st.floats(0.1, 30),
    longest_mm=st.floats(30, 1000),
    exponent=st.floats(0, 4),
    mean_um=um,
    rms_um=um,
)
evens = st.builds(Amplitude, um) | st.builds(Friction, st.floats(0, 1))


def amplitude(content: Content, w_limit_um: float = math.inf) -> AmplitudeAt:
    return Textures(CURVE, PLATE_MM, w_limit_um).amplitude(content)


@given(gratings | maps | friction_maps | gradients | noises | evens, any_place, any_place)
def test_a_texture_is_finite_and_between_its_amplitudes_everywhere(content: Content, x_mm: float, y_mm: float) -> None:
    match content:
        case Friction():
            ends = [CURVE.amplitude_um(content.friction)]
        case LevelMap(friction=(low, high)):
            ends = [CURVE.amplitude_um(low), CURVE.amplitude_um(high)]
        case Grating() | LevelMap():
            ends = [content.low_um, content.high_um]
        case Gradient():
            ends = [content.from_um, content.to_um]
        case Noise():
            ends = [max(content.mean_um + rms * content.rms_um, 0.0) for rms in (-MOST_RMS, MOST_RMS)]
        case Amplitude():
            ends = [content.amplitude_um]
    lowest, highest = min(ends), max(ends)
    rounding_um = max(1e-12 * highest, sys.float_info.min)  # halves of the least number are 0
    amplitude_um = amplitude(content)(x_mm, y_mm)
    assert lowest - rounding_um <= amplitude_um <= highest + rounding_um
    assert amplitude_um >= 0.0  # the solver refuses less, however little


@pytest.mark.parametrize("place", [(math.nan, 0.0), (0.0, math.nan), (math.inf, 0.0), (-math.inf, math.inf)])
@pytest.mark.parametrize(
    "content",
    [
        Grating(5.0, angle_rad=0.3, low_um=0.5, high_um=2.0, duty_frac=0.0),
        Grating(5.0, angle_rad=0.3, low_um=0.5, high_um=2.0, duty_frac=0.5),
        LevelMap(2, 2, b"\x00\x40\x80\xff", 0.5, 2.0),
        Gradient(5.0, angle_rad=0.3, from_um=0.5, to_um=2.0),
        Noise(seed=1, shortest_mm=1.0, longest_mm=9.0, exponent=0.5, mean_um=1.25, rms_um=0.25),
    ],
)
def test_a_place_that_is_not_finite_gives_an_amplitude_within_bounds(
    content: Content, place: tuple[float, float]
) -> None:
    assert 0.5 <= amplitude(content)(*place) <= 2.0


def test_a_sine_grating_is_a_cosine_along_its_angle_from_the_plates_centre() -> None:
    felt = amplitude(Grating(7.0, angle_rad=1.1, low_um=1.0, high_um=3.0, duty_frac=0.0))
    for x_mm, y_mm in ((0.0, 0.0), (3.0, -8.0), (-60.0, 41.0)):
        along_mm = x_mm * math.cos(1.1) + y_mm * math.sin(1.1)
        assert felt(x_mm, y_mm) == pytest.approx(2.0 + math.cos(2.0 * math.pi * along_mm / 7.0), abs=1e-12)


@pytest.mark.parametrize("duty", [0.1, 0.5, 0.75])
def test_the_duty_is_the_share_of_the_period_that_is_high_around_the_centre(duty: float) -> None:
    square = amplitude(Grating(4.0, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=duty))
    samples = [square(-40.0 + 0.01 * n, 13.0) for n in range(8000)]
    assert set(samples) == {0.0, 1.0}
    assert sum(samples) / len(samples) == pytest.approx(duty, abs=0.006)  # a sample or two at each edge
    assert square(0.0, 0.0) == 1.0


@pytest.mark.parametrize("duty_frac", [5e-324, 1e-300, 1.0 - 2.0**-53])
def test_the_detail_of_a_thin_stripe_is_at_least_a_micrometre(duty_frac: float) -> None:
    grating = Grating(0.1, angle_rad=0.0, low_um=0.0, high_um=1.0, duty_frac=duty_frac)
    assert finest_mm(grating, PLATE_MM) == 1e-3


def test_a_gradient_is_linear_along_its_angle_and_constant_beyond() -> None:
    upward = amplitude(Gradient(20.0, angle_rad=math.pi / 2, from_um=0.5, to_um=1.5))
    places_mm = ((7.0, -60.0), (7.0, -10.0), (0.0, 0.0), (-7.0, 5.0), (0.0, 60.0))
    assert [upward(*place) for place in places_mm] == pytest.approx([0.5, 0.5, 1.0, 1.25, 1.5])


ROUGH = Noise(seed=7, shortest_mm=1.0, longest_mm=16.0, exponent=0.0, mean_um=1.5, rms_um=0.2)


def sampled(noise: Noise) -> npt.NDArray[np.float64]:
    """The texture over 128 mm, four points per mm."""
    felt = amplitude(noise)
    return np.array([[felt(0.25 * column, 0.25 * row) for column in range(512)] for row in range(0, 512, 16)])


def test_noise_has_its_mean_and_its_rms_and_is_the_same_for_the_same_seed() -> None:
    um = sampled(ROUGH)
    assert um.mean() == pytest.approx(1.5, abs=0.01)
    assert um.std() == pytest.approx(0.2, rel=0.05)
    assert amplitude(ROUGH)(3.0, -4.0) == pytest.approx(1.393110, abs=1e-6)  # on every machine
    assert amplitude(replace(ROUGH, seed=8))(3.0, -4.0) != amplitude(ROUGH)(3.0, -4.0)


@pytest.mark.parametrize(("exponent", "least"), [(0.0, 0.1), (1.0, 0.0)])
def test_noise_has_the_spectrum_that_it_is_given(exponent: float, least: float) -> None:
    um = sampled(replace(ROUGH, exponent=exponent)) - 1.5
    along_1_mm = np.fft.rfftfreq(512, 0.25)
    power = (np.abs(np.fft.rfft(um * np.hanning(512), axis=1)) ** 2).sum(axis=0)
    assert power[along_1_mm > 1.1].sum() < 0.003 * power.sum()  # nothing is shorter than 1 mm
    fine = power[along_1_mm > 0.25].sum() / power.sum()  # half of the octaves, seen obliquely
    assert (fine > least) if least else (fine < 0.05)


def test_a_map_of_frictions_is_bilinear_in_friction_and_at_most_the_plates_limit() -> None:
    image = LevelMap(2, 1, b"\x00\xff", 0.0, 0.0, friction=(1.0, 0.0))
    places_mm = [(share - 0.5) * PLATE_MM[0] for share in (0.0, 0.25, 0.5, 1.0)]
    expected_um = [min(CURVE.amplitude_um(friction), 1.2) for friction in (1.0, 0.75, 0.5, 0.0)]
    assert [amplitude(image, 1.2)(x_mm, 0.0) for x_mm in places_mm] == pytest.approx(expected_um, abs=2e-3)
    assert Textures(CURVE, PLATE_MM, 1.2).refusal(image) == ""


@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 3), (3, 1), (4, 3)])
def test_a_map_has_each_pixel_at_its_centre_by_rows_from_the_far_left(width: int, height: int) -> None:
    levels = bytes((37 * n) % 256 for n in range(width * height))
    image = amplitude(LevelMap(width, height, levels, 0.0, 255.0))
    columns_mm = [PLATE_MM[0] * (column / (width - 1) - 0.5) if width > 1 else 9.0 for column in range(width)]
    rows_mm = [PLATE_MM[1] * (0.5 - row / (height - 1)) if height > 1 else 9.0 for row in range(height)]
    assert [image(x_mm, y_mm) for y_mm in rows_mm for x_mm in columns_mm] == pytest.approx(list(levels))
    if width > 1:
        assert image(0.5 * (columns_mm[0] + columns_mm[1]), rows_mm[0]) == pytest.approx(0.5 * (levels[0] + levels[1]))
