"""Wrong calls: the sentence names what was typed and the nearest valid word, and one mistake has one exit code."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from hapticd.__main__ import main

ROOT = Path(__file__).resolve().parents[1]


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    """Exit code and standard error of a call that prints nothing else."""
    try:
        code = main(arguments)
    except SystemExit as left:
        code = int(left.code or 0)
    printed = capsys.readouterr()
    assert printed.out == ""
    return code, printed.err


@pytest.fixture(autouse=True)
def _in_an_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("call", "usage", "hint"),
    [
        ("simulate strokes --sped 50", "usage: hapticd simulate ", "unknown argument --sped: did you mean --speed?"),
        ("service keys make . --forse", "usage: hapticd service keys make ", "unknown argument --forse"),
        ("status a.mcap", "usage: hapticd status ", "unknown argument a.mcap"),
        ("--vresion", "usage: hapticd ", ""),
    ],
)
def test_an_unknown_word_gets_the_usage_of_its_own_command_and_the_nearest_word(
    call: str, usage: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, complaint = refused(capsys, *call.split())
    assert code == 2
    assert complaint.startswith(usage)
    assert hint in complaint


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        ("simulat strokes", "COMMAND: there is no 'simulat': did you mean simulate?"),
        ("simulate stroke", "SCENARIO: there is no 'stroke': did you mean strokes?"),
        ("play a.png --seconds 0", "--seconds: 0 is out of bounds, it must be above 0."),
        ("simulate strokes --seconds abc", "--seconds: 'abc' is not a number."),
        ("firmware telemetry --sim --rate 0", "--rate: 0 is out of bounds, it must be 1 .. 65535."),
        ("simulate strokes --seconds 1e12", "--seconds: 1e+12 is out of bounds, it must be 0.01 .. 3600."),
        ("view --port -1", "--port: -1 is out of bounds, it must be 0 .. 65535."),
        ("firmware raw --sim --volts nan", "--volts: 'nan' is not a finite number."),
        (
            "play .",
            ".: must end in one of .png, .jpg, .jpeg, .npy, .wav, .ahap, .hjif.",
        ),
        ("calibrate touch .", "RECORDING: . is not a file: give a recording (.mcap)."),
    ],
)
def test_a_wrong_value_is_one_sentence_with_the_name_that_was_typed(
    call: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(capsys, *call.split()) == (2, f"hapticd: {sentence}\n")


@pytest.mark.parametrize(
    "call",
    [
        # a file that is not there
        "replay none.mcap",
        "calibrate friction --readings none.csv",
        "service keys allow . none.key",
        # a value that cannot be
        "simulate strokes --speed nan",
        "plate map --finger 900,0",
        "service keys make . a/b",
        "calibrate trackpad --sim --marks 1",
        # an option that is missing
        "firmware info",
        "calibrate friction",
    ],
)
def test_a_mistake_in_a_call_is_exit_code_2_everywhere(call: str, capsys: pytest.CaptureFixture[str]) -> None:
    code, complaint = refused(capsys, *call.split())
    assert (code, complaint.count("\n")) == (2, 1)


CONFIGURATIONS = {
    "missing": None,
    "not TOML": "[plate",
    "unknown key": "[plate]\nsize = 1\n",
    "missing map": '[plate]\nmodes_file = "none.npz"\n',
    "replay file that is none": '[trackpad]\nsource = "replay"\ndevice = "hapticd.toml"\n[sim]\nrig_dir = "."\n',
    "map that is none": '[plate]\nmodes_file = "hapticd.toml"\n[sim]\nrig_dir = "."\n',
    "keys that are not there": '[client]\ntcp = "127.0.0.1:7410"\nkeys_dir = "none"\n[sim]\nrig_dir = "."\n',
}


@pytest.mark.parametrize("text", CONFIGURATIONS.values(), ids=list(CONFIGURATIONS))
def test_a_mistake_in_the_configuration_is_exit_code_78(text: str | None, capsys: pytest.CaptureFixture[str]) -> None:
    """By which systemd knows that a restart changes nothing."""
    if text is not None:
        Path("hapticd.toml").write_text(text, encoding="utf-8")
    code, complaint = refused(capsys, "run", "--check", "--config", "hapticd.toml")
    assert (code, complaint.count("\n")) == (78, 1)


@pytest.mark.parametrize(
    "call",
    [
        "firmware info --port none",
        pytest.param("record a.mcap --endpoint .", id="record without a daemon"),
    ],
)
def test_what_fails_though_the_call_is_right_is_exit_code_1(
    call: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapticd.tools.record.attach.HEADER_WITHIN_S", 0.05)
    code, complaint = refused(capsys, *call.split())
    assert (code, complaint.count("\n")) == (1, 1)


def test_without_the_study_s_distribution_the_folders_to_install_are_named(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "hapticd_study", None)
    code, complaint = refused(capsys, "study", "run", "--participant", "P1")
    assert (code, complaint.count("\n")) == (1, 1)
    assert all(folder in complaint for folder in ("pip install", "clients/python", "clients/study"))
