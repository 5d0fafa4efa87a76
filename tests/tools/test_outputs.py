"""One rule for the output files of all commands: nothing is overwritten that --force does not name."""

from __future__ import annotations

from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.errors import HapticdError, UsageError
from hapticd.regular_file import opened
from hapticd.tools import outputs

# A call of each command up to its output, a name with the right suffix, and one with that of another kind of file.
OUTPUTS = [
    (("simulate", "rest", "--json"), "f.json", "f.npz"),
    (("simulate", "rest", "--out"), "f.npz", "f.json"),
    (("simulate", "rest", "--plot"), "f.png", "f.mcap"),
    (("simulate", "rest", "--record"), "f.mcap", "f.png"),
    (("export", "in.mcap", "--plot"), "f.png", "f.mcap"),
    (("export", "in.mcap", "--hdf5"), "f.h5", "f.mcap"),
    (("plate", "map", "--finger=1,2", "--plot"), "f.pdf", "f.npz"),
    (("plate", "map", "--finger=1,2", "--out"), "f.npz", "f.png"),
    (("plate", "--out"), "f.csv", "f.png"),
    (("plate", "--plot"), "f.svg", "f.toml"),
    (("plate", "--json"), "f.json", "f"),
    (("doctor", "latency", "--sim", "--json"), "f.json", "f.csv"),
    (("doctor", "latency", "--sim", "--plot"), "f.PNG", "f.toml"),
    (("bench", "tick", "--json"), "f.json", "f.png"),
    (("firmware", "sweep", "--plot"), "f.png", "f.toml"),
    (("doctor", "--bundle"), "f.tar.gz", "f.tar"),
    (("demo", "--out"), "f.png", "f.json"),
]
IDS = [" ".join(command) for command, _, _ in OUTPUTS]


@pytest.fixture(autouse=True)
def _in_an_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("in.mcap").write_text("a recording", encoding="utf-8")


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one sentence of a call that is refused as a wrong call, before any work."""
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


@pytest.mark.parametrize(("command", "name"), [row[:2] for row in OUTPUTS], ids=IDS)
def test_an_existing_file_is_kept(command: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]) -> None:
    Path(name).write_text("a day's work", encoding="utf-8")
    assert refused(capsys, *command, name).startswith(f"hapticd: {name}: exists already")
    assert Path(name).read_text(encoding="utf-8") == "a day's work"


@pytest.mark.parametrize("force", [[], ["--force"]], ids=["plain", "forced"])
@pytest.mark.parametrize(("command", "other"), [row[::2] for row in OUTPUTS], ids=IDS)
def test_a_file_of_another_kind_is_never_overwritten(
    command: tuple[str, ...], other: str, force: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path(other).write_text("a day's work", encoding="utf-8")
    assert refused(capsys, *command, other, *force).startswith(
        f"hapticd: {other}: has the name of another kind of file"
    )
    assert Path(other).read_text(encoding="utf-8") == "a day's work"


@pytest.mark.parametrize(("command", "name"), [row[:2] for row in OUTPUTS], ids=IDS)
def test_a_folder_that_is_missing_is_refused(
    command: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "its directory is missing" in refused(capsys, *command, f"nowhere/{name}")
    Path(name).mkdir()
    assert "is a directory" in refused(capsys, *command, name)


@pytest.mark.parametrize(
    "command",
    [
        ("export", "same.png", "--plot", "same.png"),
        ("export", "link.png", "--plot", "same.png"),
        ("export", "same.h5", "--hdf5", "same.h5"),
        ("plate", "map", "--finger=1,2", "--modes", "same.npz", "--out", "same.npz"),
        ("plate", "map", "--finger=1,2", "--modes", "./same.npz", "--out", "same.npz"),
    ],
    ids=" ".join,
)
def test_an_input_is_not_overwritten_even_by_force(
    command: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("same.png", "same.h5", "same.npz"):
        Path(name).write_text("a day's work", encoding="utf-8")
    Path("link.png").symlink_to("same.png")
    assert "is an input of this command" in refused(capsys, *command, "--force")
    assert Path(command[-1]).read_text(encoding="utf-8") == "a day's work"


def test_a_forced_output_is_replaced(capsys: pytest.CaptureFixture[str]) -> None:
    Path("map.npz").write_text("old", encoding="utf-8")
    arguments = ("plate", "map", "--finger=-30,20", "--cells", "3", "--out", "map.npz")
    assert main([*arguments, "--force"]) == 0
    capsys.readouterr()
    assert Path("map.npz").read_bytes().startswith(b"PK")


def test_an_output_gets_its_name_when_it_is_whole() -> None:
    Path("f.json").write_text("old", encoding="utf-8")

    def half() -> None:
        with opened(Path("f.json")) as file:
            file.write(b"half")
            raise HapticdError("stopped")

    with pytest.raises(HapticdError, match="stopped"):
        half()
    assert Path("f.json").read_text(encoding="utf-8") == "old"
    assert sorted(path.name for path in Path().iterdir()) == ["f.json", "in.mcap"]


def test_two_outputs_of_one_name_are_refused() -> None:
    with pytest.raises(UsageError, match="named for two outputs"):
        outputs.check([Path("f.json"), Path("./f.json").absolute()])


def test_a_device_is_written_under_any_name(capsys: pytest.CaptureFixture[str]) -> None:
    outputs.check_suffix(Path("/dev/null"), outputs.JSON)
    outputs.check([Path("/dev/null")])
    outputs.write_text("figures", "/dev/null")
    outputs.write_text("figures", "-")
    assert capsys.readouterr().out == "figures"


@pytest.mark.parametrize(
    ("step", "option", "name"), [("modes", "--scan", "modes.npz"), ("friction", "--readings", "friction.png")]
)
def test_a_calibration_step_overwrites_neither_its_input_nor_what_it_did_not_write(
    step: str, option: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = Path(name)
    given.write_text("a day's work", encoding="utf-8")
    assert "is an input" in refused(capsys, "calibrate", step, option, str(given), "--out", ".", "--force")
    given.unlink()
    Path("hapticd.toml").write_text("[plate]\n", encoding="utf-8")
    assert "hapticd.toml: exists already" in refused(capsys, "calibrate", step, "--sim", "--out", ".")
    Path(f"{step}.png").write_text("a day's work", encoding="utf-8")
    assert f"{step}.png: exists already" in refused(capsys, "calibrate", step, "--sim", "--out", ".")


def test_a_recording_that_fails_leaves_the_earlier_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(_scenario: object, path: Path, **_: object) -> None:
        path.write_text("half", encoding="utf-8")
        raise HapticdError("the disk is full")

    monkeypatch.setattr("hapticd.tools.record.simulated.run", failing)
    Path("run.mcap").write_text("a day's work", encoding="utf-8")
    assert main(["simulate", "rest", "--record", "run.mcap", "--force"]) == 1
    assert capsys.readouterr().err == "hapticd: the disk is full\n"
    assert Path("run.mcap").read_text(encoding="utf-8") == "a day's work"
    assert sorted(path.name for path in Path().iterdir()) == ["in.mcap", "run.mcap"]
