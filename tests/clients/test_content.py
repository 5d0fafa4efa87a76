"""Files that people have, as surfaces and effects: what is kept, what is dropped, and what a plate then plays."""

from __future__ import annotations

import json
import math
import struct
import wave
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_daemon import FakeDaemon
from hypothesis import example, given
from hypothesis import strategies as st
from PIL import Image

from hapticd.wire.client import decode_targets
from hapticd_client import Client, Envelope, HapticdError, Modulation, RefusedError, content
from hapticd_client.checks import checked
from hapticd_client.content.score import MAX_LIVE, Score
from hapticd_client.content.track import STEP_S, chunks, summed, thinned
from hapticd_client.target_set import MAX_POINTS, TargetSet
from hapticd_contract.effects import Effect

# --- helpers ----------------------------------------------------------------------------------------------------


def written(path: Path, document: Any) -> Path:
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def ahap(path: Path, *pattern: dict[str, Any]) -> Path:
    return written(path / "a.ahap", {"Version": 1.0, "Metadata": {"Project": "test"}, "Pattern": list(pattern)})


def event(kind: str, time_s: float, duration_s: float | None = None, **parameters: float) -> dict[str, Any]:
    listed = [{"ParameterID": name, "ParameterValue": value} for name, value in parameters.items()]
    length = {} if duration_s is None else {"EventDuration": duration_s}
    return {"Event": {"Time": time_s, "EventType": kind, **length, "EventParameters": listed}}


def curve(name: str, time_s: float, *points: tuple[float, float]) -> dict[str, Any]:
    listed = [{"Time": t_s, "ParameterValue": value} for t_s, value in points]
    return {"ParameterCurve": {"ParameterID": name, "Time": time_s, "ParameterCurveControlPoints": listed}}


def hjif(path: Path, *perceptions: dict[str, Any], **fields: Any) -> Path:
    return written(path / "a.hjif", {"version": "2023", "perceptions": list(perceptions), **fields})


def perception(modality: str, *bands: dict[str, Any], library: Any = (), **channel: Any) -> dict[str, Any]:
    channels = [{"id": 0, "gain": 1.0, "mixing_coefficient": 1.0, "bands": list(bands), **channel}]
    return {"id": 0, "perception_modality": modality, "channels": channels, "effect_library": list(library)}


def band(kind: str, *effects: dict[str, Any], **fields: Any) -> dict[str, Any]:
    return {
        "band_type": kind,
        "lower_frequency_limit": 0,
        "upper_frequency_limit": 200,
        "effects": list(effects),
    } | fields


def effect(position: int, *frames: tuple[int, float | None, int | None], **fields: Any) -> dict[str, Any]:
    names = ("relative_position", "amplitude_modulation", "frequency_modulation")
    keyframes = [
        {name: value for name, value in zip(names, frame, strict=True) if value is not None} for frame in frames
    ]
    basis = {"effect_type": "Basis", "position": position, "phase": 0, "base_signal": "Sine", "keyframes": keyframes}
    return basis | fields


def wav(path: Path, samples: np.ndarray, rate_hz: int = 8000, channels: int = 1) -> Path:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(2)
        file.setframerate(rate_hz)
        file.writeframes(np.round(samples * 32000).astype("<i2").tobytes())
    return path


def felt(score: Score, t_s: float) -> float:
    """The envelopes' amplitude at an instant."""
    total_um = 0.0
    for one in score.effects:
        if isinstance(one.form, Envelope) and one.begin_s <= t_s < one.end_s:
            points = list(one.form.points)
            total_um += float(np.interp(t_s - one.begin_s, [p[0] for p in points], [p[1] for p in points]))
    return total_um


def tones(score: Score) -> list[tuple[float, float, float, str]]:
    """Of each modulation when it begins and ends, its frequency and its shape."""
    return [
        (round(one.begin_s, 3), round(one.end_s, 3), round(one.form.frequency_hz, 1), one.form.shape)
        for one in score.effects
        if isinstance(one.form, Modulation)
    ]


# --- tracks -----------------------------------------------------------------------------------------------------

points = st.lists(st.tuples(st.floats(0, 5), st.floats(0, 1)), min_size=1, max_size=12).map(
    lambda found: sorted(found, key=lambda point: point[0])
)


@example([[(0.0, 0.0), (5e-324, 1.0), (4.5, 0.0), (5.0, 0.0)]])
@given(st.lists(points, min_size=1, max_size=5))
def test_what_is_summed_and_thinned_is_understood_by_the_daemon(lines: list[list[tuple[float, float]]]) -> None:
    line = thinned(summed(lines))
    assert all(0.0 <= value <= 1.0 for _, value in line)
    assert all(after == before or after - before >= STEP_S * 0.999 for (before, _), (after, _) in pairwise(line[:-1]))
    targets = TargetSet()
    for index, chunk in enumerate(chunks(line)[:MAX_LIVE]):
        form = Envelope([(t_s - chunk[0][0], value) for t_s, value in chunk])
        targets = targets.with_effect(checked(Effect.of(form, name=f"{index}")), 0.5)
    decode_targets(targets.payload("c", None))


def test_all_envelopes_that_are_sent_at_once_have_room_in_a_message() -> None:
    jagged = [(STEP_S * index, float(index % 2)) for index in range(5000)]
    longest = sorted((len(chunk) for chunk in chunks(thinned(summed([jagged])))), reverse=True)
    assert len(longest) > MAX_LIVE
    assert sum(longest[:MAX_LIVE]) <= MAX_POINTS


# --- AHAP -------------------------------------------------------------------------------------------------------


def test_transients_are_pulses_shorter_when_sharp(tmp_path: Path) -> None:
    file = ahap(
        tmp_path,
        event("HapticTransient", 0.1, HapticIntensity=0.5, HapticSharpness=0.0),
        event("HapticTransient", 0.3, HapticIntensity=1.0, HapticSharpness=1.0),
    )
    score = content.load(file, high_um=2.0)
    assert [felt(score, t_s) for t_s in (0.05, 0.115, 0.129, 0.2, 0.305, 0.312)] == pytest.approx(
        [0.0, 1.0, 0.125, 0.0, 2.0, 0.0], abs=0.01
    )
    assert score.length_s == pytest.approx(0.31)


def test_a_continuous_event_follows_its_curve_at_its_sharpness_s_frequency(tmp_path: Path) -> None:
    file = ahap(
        tmp_path,
        event("HapticContinuous", 0.0, 1.0, HapticIntensity=0.8, HapticSharpness=0.5),
        curve("HapticIntensityControl", 0.0, (0.0, 1.0), (0.5, 0.5), (1.0, 0.0)),
        curve("HapticSharpnessControl", 0.0, (0.0, -0.5)),
    )
    score = content.load(file, high_um=1.0)
    assert [felt(score, t_s) for t_s in (0.01, 0.25, 0.5, 0.75)] == pytest.approx([0.79, 0.6, 0.4, 0.2], abs=0.01)
    assert tones(score) == [(0.0, 1.0, 80.0, "sine")]


@pytest.mark.parametrize(
    ("item", "sentence"),
    [
        (event("AudioCustom", 0.0), "events AudioCustom"),
        (event("HapticTransient", 0.0, AttackTime=0.1), "event parameters AttackTime"),
        (curve("AudioVolumeControl", 0.0, (0.0, 1.0)), "parameter curves of AudioVolumeControl"),
        ({"Parameter": {"ParameterID": "HapticDecayTimeControl", "ParameterValue": 1}}, "dynamic parameters Haptic"),
    ],
)
def test_what_of_an_ahap_file_is_dropped_is_a_warning(item: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    with pytest.warns(content.DroppedWarning, match=sentence):
        content.load(ahap(tmp_path, event("HapticTransient", 0.0), item))


# --- hjif -------------------------------------------------------------------------------------------------------


def test_waves_curves_and_transients_of_mpeg_are_envelopes_and_tones(tmp_path: Path) -> None:
    library = [effect(0, (0, 1.0, None), (100, 0.5, None)) | {"id": 7}]
    file = hjif(
        tmp_path,
        perception(
            "Vibrotactile",
            band("Wave", effect(0, (0, 0.5, 60), (200, 1.0, None))),
            band("Curve", effect(500, (0, 0.0, None), (100, -1.0, None)), curve_type="Linear"),
            band("Transient", effect(1000, (0, 0.8, 250))),
            band("Curve", {"effect_type": "Reference", "id": 7, "position": 1500}),
            library=library,
            gain=0.5,
        ),
        timescale=1000,
    )
    score = content.load(file, high_um=2.0)
    times_s = (0.001, 0.1, 0.199, 0.55, 1.005, 1.501, 1.599)
    assert [felt(score, t_s) for t_s in times_s] == pytest.approx([0.5, 0.75, 1.0, 0.5, 0.8, 1.0, 0.5], abs=0.02)
    assert tones(score) == [(0.0, 0.2, 60.0, "sine")]


def test_friction_and_texture_of_mpeg_lie_on_the_plate(daemon: FakeDaemon, client: Client, tmp_path: Path) -> None:
    file = hjif(
        tmp_path,
        perception("Friction", band("Curve", effect(0, (0, 1.0, None), (137, 0.0, None)))),
        perception("Vibrotactile Texture", band("Wave", effect(0, (0, 0.5, 250), (100, 0.5, None)))),
    )
    score = content.load(file, high_um=2.0)
    assert score.effects == ()
    profile, stripes = score.layers
    Score("", (profile,)).lay(client)
    felt_um = [daemon.felt_um(x_mm, 5.0) for x_mm in (-68.0, 0.0, 68.0)]
    assert felt_um[0] < felt_um[1] < felt_um[2]
    assert felt_um[2] == pytest.approx(2.0, abs=0.1)
    Score("", (stripes,)).lay(client)
    felt_um = [daemon.felt_um(x_mm, 5.0) for x_mm in (0.0, 2.0, 4.0)]
    assert felt_um == pytest.approx([1.0, 0.0, 1.0], abs=1e-9)


@pytest.mark.parametrize(
    ("one", "sentence"),
    [
        (perception("Vibrotactile", band("WaveletWave")), "bands WaveletWave"),
        (perception("Vibrotactile", band("Curve", {"effect_type": "Reference", "id": 9})), "does not have"),
        (
            perception("Vibrotactile", band("Wave", effect(0, (0, 1.0, 40), (9, 1.0, None), base_signal="SawToothUp"))),
            "signals SawToothUp",
        ),
        (perception("Vibrotactile", band("Wave", effect(0, (0, 1.0, 40), (9, 1.0, 90)))), "frequencies that glide"),
        (perception("Vibrotactile", band("Wave", effect(0, (0, 1.0, 900), (9, 1.0, None)))), "900 becomes 300"),
    ],
)
def test_what_of_an_mpeg_file_is_dropped_is_a_warning(one: dict[str, Any], sentence: str, tmp_path: Path) -> None:
    kept = perception("Pressure", band("Curve", effect(0, (0, 1.0, None), (9, 1.0, None))))
    with pytest.warns(content.DroppedWarning, match=sentence):
        content.load(hjif(tmp_path, kept, one))


# --- sound ------------------------------------------------------------------------------------------------------


def test_a_sound_s_loudness_and_pitch_are_an_envelope_and_a_modulation(tmp_path: Path) -> None:
    t_s = np.arange(8000) / 8000
    loudness = np.where(t_s < 0.5, 0.25, 0.75)
    score = content.load(wav(tmp_path / "a.wav", loudness * np.sin(2 * math.pi * 110 * t_s)), high_um=1.5)
    assert [felt(score, at_s) for at_s in (0.2, 0.8)] == pytest.approx([0.5, 1.5], abs=0.1)
    assert [round(hz, -1) for _, _, hz, _ in tones(score)] == [110.0]
    assert tones(score)[0][:2] == pytest.approx((0.0, 1.0), abs=0.005)


def test_a_high_sound_is_felt_by_its_loudness_and_channels_by_their_mean(tmp_path: Path) -> None:
    t_s = np.arange(8000) / 8000
    both = np.stack([np.sin(2 * math.pi * 3100 * t_s), np.sin(2 * math.pi * 3100 * t_s)], axis=1)
    file = wav(tmp_path / "a.wav", 0.5 * both.ravel(), channels=2)
    with pytest.warns(content.DroppedWarning) as dropped:
        score = content.load(file)
    assert {str(one.message) for one in dropped} == {
        "2 channels: their mean is played.",
        "sound without a pitch of 20 .. 300 Hz: only its loudness is felt.",
    }
    assert tones(score) == []
    assert felt(score, 0.5) == pytest.approx(1.5, abs=0.1)


def test_loudness_and_pitch_of_a_long_sound_stay_together_at_any_sampling_rate(tmp_path: Path) -> None:
    """At 11 025 Hz 10 ms are 110.25 samples: frames of whole samples that count as 10 ms would end 0.14 s late."""
    t_s = np.arange(60 * 11025) / 11025
    sound = np.where(t_s < 59.0, 0.25, 0.75) * np.sin(2 * math.pi * np.where(t_s < 59.0, 60.0, 120.0) * t_s)
    score = content.load(wav(tmp_path / "a.wav", sound, rate_hz=11025), high_um=1.5)
    assert score.length_s == pytest.approx(60.0, abs=1e-9)
    assert [felt(score, at_s) for at_s in (58.97, 59.03)] == pytest.approx([0.5, 1.5], abs=0.1)
    begins_s, ends_s, hz, _ = tones(score)[-1]
    assert (begins_s, ends_s) == pytest.approx((59.0, 60.0), abs=0.11)
    assert round(hz, -1) == 120.0


# --- pictures ---------------------------------------------------------------------------------------------------


def test_a_picture_is_amplitude_over_the_plate_or_friction_in_millimetres(
    daemon: FakeDaemon, client: Client, tmp_path: Path
) -> None:
    levels = np.tile(np.array([0] * 150 + [255] * 150, dtype=np.uint8), (100, 1))
    Image.fromarray(levels).save(tmp_path / "half.png")
    np.save(tmp_path / "half.npy", levels)

    content.load(tmp_path / "half.png", high_um=1.0).play(client, 0.0)
    assert [daemon.felt_um(x_mm) for x_mm in (-60.0, 60.0)] == [0.0, 1.0]
    score = content.load(tmp_path / "half.png", is_friction=True, width_mm=60.0)
    score.play(client, 0.0)
    assert [daemon.felt_um(x_mm) for x_mm in (-29.0, 29.0, 31.0)] == pytest.approx([0.0, 2.0, 0.0])
    assert score.title == "half.png: a map of 300 x 100"
    content.load(tmp_path / "half.npy", width_mm=30.0).play(client, 0.0)
    assert [daemon.felt_um(x_mm) for x_mm in (-14.0, 14.0, 16.0)] == [0.0, 1.5, 0.0]


# --- playing ----------------------------------------------------------------------------------------------------


class Plate:
    """A plate whose clock goes on with each sleep."""

    def __init__(self) -> None:
        self.t_s = 100.0
        self.live: dict[str, float] = {}
        self.played: list[tuple[float, float]] = []
        self.asked = 0

    def status(self) -> dict[str, int]:
        self.asked += 1
        return {"t_ns": round(self.t_s * 1e9)}

    def effect(self, name: str, _form: Any, start: Any) -> None:
        assert name not in self.live
        assert start.t_ns * 1e-9 > self.t_s
        self.live[name] = start.t_ns * 1e-9
        assert len(self.live) <= 16
        self.played.append((round(start.t_ns * 1e-9 - 100.0, 3), round(self.t_s - 100.0, 3)))

    def stop(self, name: str) -> None:
        assert self.t_s > self.live.pop(name)

    def sleep(self, seconds: float) -> None:
        self.t_s += seconds

    def clock(self) -> float:
        return self.t_s


def played(score: Score, seconds: float = math.inf, **options: Any) -> Plate:
    plate = Plate()
    score.play(plate, seconds, sleep=plate.sleep, clock=plate.clock, **options)
    return plate


def clicks(tmp_path: Path, count: int) -> Score:
    return content.load(ahap(tmp_path, *[event("HapticTransient", 0.5 * index) for index in range(count)]))


def test_each_effect_is_sent_half_a_second_ahead_and_stopped_at_its_end(tmp_path: Path) -> None:
    plate = played(clicks(tmp_path, 30))
    assert [begin_s for begin_s, _ in plate.played] == [pytest.approx(0.1 + 0.5 * index) for index in range(30)]
    assert all(0.4 < begin_s - sent_s <= 0.5 for begin_s, sent_s in plate.played[1:])
    assert plate.live == {}
    assert plate.asked > 10  # a daemon that is gone would be found


def test_what_the_plate_refuses_is_dropped_and_the_rest_is_played(tmp_path: Path) -> None:
    score, plate = clicks(tmp_path, 3), Plate()
    effect = plate.effect

    def refuse_the_second(name: str, form: Any, start: Any) -> None:
        if name == "content 1":
            raise RefusedError("effect 'content 1' needs more knots than a frame has.")
        effect(name, form, start)

    plate.effect = refuse_the_second
    with pytest.warns(content.DroppedWarning, match="needs more knots than a frame has\\.$"):
        score.play(plate, sleep=plate.sleep, clock=plate.clock)
    assert [begin_s for begin_s, _ in plate.played] == pytest.approx([0.1, 1.1])


def test_a_loop_begins_again_without_a_gap_until_its_time_is_up(tmp_path: Path) -> None:
    score = clicks(tmp_path, 2)  # 0.52 s
    begins_s = [begin_s for begin_s, _ in played(score, 2.0, loops=True).played]
    assert begins_s[:4] == pytest.approx([0.1, 0.6, 0.1 + score.length_s, 0.6 + score.length_s], abs=1e-3)
    assert 6 <= len(begins_s) <= 10


# --- what is too large ------------------------------------------------------------------------------------------


def npy(header: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) + 1) + header + b"\n"


@pytest.mark.parametrize(
    ("ticks", "sentence"), [(10**6, "lasts 1000 s, it must last 600 s"), (10**25, "too far from 0")]
)
def test_keyframes_too_far_apart_are_refused(ticks: int, sentence: str, tmp_path: Path) -> None:
    line = effect(0, (0, 1.0, None), (ticks, 1.0, None))
    with pytest.raises(RefusedError, match=sentence):
        content.load(hjif(tmp_path, perception("Vibrotactile", band("Curve", line))))


def test_a_picture_with_too_many_pixels_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    Image.new("1", (5000, 4000)).save(tmp_path / "a.png")
    with pytest.raises(RefusedError, match=r"a\.png: has 5000 x 4000 pixels, at most 16000000 can be read: reduce it"):
        content.load(tmp_path / "a.png")


# --- what is wrong ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "data", "sentence"),
    [
        ("a.txt", b"", "a.txt: must end in one of .png"),
        ("a.ahap", b'{"Pattern": [{"Event": {"EventType": 3}}]}', "a.ahap.Pattern[0].Event.EventType: must be a text."),
        (
            "a.ahap",
            b'{"Pattern": [{"Event": {"EventType": "HapticTransient", "Time": NaN}}]}',
            "Time: must be a number.",
        ),
        (
            "a.ahap",
            b'{"Pattern": [{"Event": {"EventType": "HapticTransient", "Time": 1' + b"0" * 400 + b"}}]}",
            "a.ahap.Pattern[0].Event.Time: must be a number.",
        ),
        (
            "a.ahap",
            b'{"Pattern": [{"Event": {"EventType": "HapticTransient", "Time": -5}}]}',
            "a.ahap.Pattern[0].Event.Time: must be 0 or more.",
        ),
        ("a.ahap", b'{"Pattern": [' + b"{}," * 10_000 + b"{}]}", "a.ahap.Pattern: has 10001 entries, at most 10000"),
        ("a.npy", npy(b"{'descr': '|u1', 'fortran_order': False, 'shape': (3000000, 3000000), }"), "is not an array"),
        ("a.npy", npy(b"'''"), "a.npy: is not an array that NumPy can read."),
        ("a.hjif", b'{"perceptions": [{}], "timescale": 0}', "a.hjif.timescale: must be above 0."),
        ("a.png", b"no picture", "a.png: is not a PNG or JPEG that Pillow can read."),
    ],
)
def test_a_file_that_cannot_be_played_is_one_sentence(name: str, data: bytes, sentence: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(HapticdError) as refused:
        content.load(tmp_path / name)
    assert sentence in str(refused.value)
    assert str(refused.value).endswith(".") or "must end in one of" in sentence


leaves = st.sampled_from(["HapticTransient", "Wave", 0, -1, 250, -1e300, 1e300, None, True]) | st.floats()
strange = st.recursive(
    leaves, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(), inner, max_size=3)
)
WHOLE = {
    "Pattern": [
        event("HapticContinuous", 0.0, 1.0, HapticIntensity=0.8),
        curve("HapticIntensityControl", 0.0, (0.0, 1.0), (0.5, 0.5)),
    ],
    "timescale": 1000,
    "perceptions": [
        perception(
            "Vibrotactile",
            band("Wave", effect(0, (0, 0.5, 60), (200, 1.0, None)), {"effect_type": "Reference", "id": 7}),
            band("Transient", effect(1000, (0, 0.8, 250))),
            library=[effect(0, (0, 1.0, None), (9, 0.5, None)) | {"id": 7}],
        ),
        perception("Friction", band("Curve", effect(0, (0, 1.0, None), (137, 0.0, None)), curve_type="Linear")),
        perception("Vibrotactile Texture", band("Wave", effect(0, (0, 0.5, 250)))),
    ],
}


def damaged(document: Any, path: list[int], value: Any) -> Any:
    """Replace one place of a document."""
    if not path or not isinstance(document, (dict, list)) or not document:
        return value
    keys = list(document) if isinstance(document, dict) else list(range(len(document)))
    key = keys[path[0] % len(keys)]
    copy = document.copy()
    copy[key] = damaged(copy[key], path[1:], value)
    return copy


@pytest.mark.filterwarnings("ignore::hapticd_client.content.DroppedWarning")
@given(st.sampled_from(["ahap", "hjif"]), st.lists(st.integers(0, 20), max_size=9), strange)
def test_a_damaged_file_is_refused_or_gives_effects_that_the_library_sends(
    tmp_path_factory: pytest.TempPathFactory, suffix: str, path: list[int], value: Any
) -> None:
    file = written(tmp_path_factory.getbasetemp() / f"damaged.{suffix}", damaged(WHOLE, path, value))
    try:
        score = content.load(file)
    except HapticdError:
        return
    assert math.isfinite(score.length_s)
    for one in score.effects:
        assert one.begin_s >= 0.0
        assert checked(one.form)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_picture_of_another_format_is_refused_whatever_its_name(suffix: str, tmp_path: Path) -> None:
    for kind in ("GIF", "BMP", "TIFF", "WEBP", "EPS"):
        Image.new("RGB", (8, 8)).save(tmp_path / "a", kind)
        (tmp_path / "a").replace(tmp_path / f"a{suffix}")
        with pytest.raises(RefusedError, match="is not a PNG or JPEG that Pillow can read"):
            content.load(tmp_path / f"a{suffix}")
