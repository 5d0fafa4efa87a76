"""`hapticd service install`: its listing, the files it writes, and the configuration that it keeps."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.errors import HapticdError
from hapticd.tools.install_service import DESTINATIONS, HIDDEN_BY_UNIT, install, listing, service_files

SYSTEMD = Path(__file__).parents[2] / "systemd"
PROGRAM = Path("/opt/plate/bin/hapticd")


@pytest.fixture
def report(tmp_path: Path) -> str:
    """What an installation below `tmp_path` reports."""
    return install(service_files(SYSTEMD, PROGRAM), tmp_path)


def test_all_files_go_where_the_system_looks_and_the_unit_starts_this_program(report: str, tmp_path: Path) -> None:
    for name, destination in DESTINATIONS.items():
        path = tmp_path / destination
        assert stat.S_IMODE(path.stat().st_mode) == 0o644
        assert f"installed  {path}" in report
        text = path.read_text().replace(f"\nExecStart={PROGRAM} run", "\nExecStart=/opt/hapticd/bin/hapticd run")
        assert text == (SYSTEMD / name).read_text()
    assert "systemctl enable --now hapticd" in report


@pytest.mark.usefixtures("report")
def test_a_configuration_that_is_there_is_left_alone_and_the_rest_renewed(tmp_path: Path) -> None:
    configuration, unit = (tmp_path / DESTINATIONS[name] for name in ("hapticd.toml", "hapticd.service"))
    configuration.write_text("# mine\n")
    unit.write_text("# old\n")
    assert f"kept       {configuration}" in install(service_files(SYSTEMD, PROGRAM), tmp_path)
    assert (configuration.read_text(), unit.read_text() == "# old\n") == ("# mine\n", False)


@pytest.mark.parametrize("place", HIDDEN_BY_UNIT)
def test_a_program_out_of_the_service_s_sight_is_refused_before_any_write(place: str, tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match="is hidden from the service"):
        install(service_files(SYSTEMD, Path(f"{place}/venv/bin/hapticd")), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_everything_is_shown_and_nothing_changed_with_print(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["service", "install", "--print"]) == 0
    output = capsys.readouterr().out
    assert output == listing(service_files())
    assert all(f"# --- /{destination}\n" in output for destination in DESTINATIONS.values())


@pytest.mark.usefixtures("report")
def test_what_was_installed_is_removed_and_the_configuration_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    remove = ["service", "remove", "--root", str(tmp_path)]
    wants = tmp_path / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    (wants / "hapticd.service").symlink_to("/etc/systemd/system/hapticd.service")
    assert main(remove) == 1  # it is enabled
    assert "run `systemctl disable --now hapticd` before" in capsys.readouterr().err
    (wants / "hapticd.service").unlink()
    before = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    assert main([*remove, "--print"]) == 0
    assert capsys.readouterr().out.count("removed") == len(DESTINATIONS) - 1
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == before
    assert main(remove) == 0
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [tmp_path / DESTINATIONS["hapticd.toml"]]
    assert "systemctl daemon-reload" in capsys.readouterr().out
    assert main([*remove, "--root", str(tmp_path / "empty")]) == 0
    assert capsys.readouterr().out == f"nothing of hapticd's service is below {tmp_path / 'empty'}\n"
