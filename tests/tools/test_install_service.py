"""`hapticd service install`: its listing, the files it writes, and the configuration that it keeps."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.errors import HapticdError
from hapticd.tools.install_service import DESTINATIONS, HIDDEN_BY_UNIT, ServiceFile, install, listing, service_files

SYSTEMD = Path(__file__).parents[2] / "systemd"
PROGRAM = Path("/opt/plate/bin/hapticd")


def files() -> tuple[ServiceFile, ...]:
    return service_files(SYSTEMD, PROGRAM)


def test_all_files_go_where_the_system_looks_for_them(tmp_path: Path) -> None:
    output = install(files(), tmp_path)
    for name, destination in DESTINATIONS.items():
        path = tmp_path / destination
        assert stat.S_IMODE(path.stat().st_mode) == 0o644
        assert f"installed  {path}" in output
        if name != "hapticd.service":
            assert path.read_text() == (SYSTEMD / name).read_text()
    assert "systemctl enable --now hapticd" in output


def test_the_unit_starts_this_program_and_is_else_the_same(tmp_path: Path) -> None:
    install(files(), tmp_path)
    unit = (tmp_path / DESTINATIONS["hapticd.service"]).read_text()
    assert f"\nExecStart={PROGRAM} run --config /etc/hapticd/hapticd.toml\n" in unit
    assert unit.replace(str(PROGRAM), "/opt/hapticd/bin/hapticd") == (SYSTEMD / "hapticd.service").read_text()


def test_a_configuration_that_is_there_is_left_alone_and_the_rest_renewed(tmp_path: Path) -> None:
    install(files(), tmp_path)
    configuration, unit = (tmp_path / DESTINATIONS[name] for name in ("hapticd.toml", "hapticd.service"))
    configuration.write_text("# mine\n")
    unit.write_text("# old\n")
    assert f"kept       {configuration}" in install(files(), tmp_path)
    assert configuration.read_text() == "# mine\n"
    assert unit.read_text() != "# old\n"


@pytest.mark.parametrize("place", [f"{hidden}/venv/bin/hapticd" for hidden in HIDDEN_BY_UNIT])
def test_a_program_that_the_service_could_not_see_is_refused_before_anything_is_written(
    place: str, tmp_path: Path
) -> None:
    with pytest.raises(HapticdError, match="is hidden from the service"):
        install(service_files(SYSTEMD, Path(place)), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_everything_is_shown_and_nothing_changed_with_print(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["service", "install", "--print"]) == 0
    output = capsys.readouterr().out
    assert output == listing(service_files())
    for destination in DESTINATIONS.values():
        assert f"# --- /{destination}\n" in output


def test_what_was_installed_is_removed_and_the_configuration_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    install(files(), tmp_path)
    before = sorted(path for path in tmp_path.rglob("*") if path.is_file())
    assert main(["service", "remove", "--root", str(tmp_path), "--print"]) == 0
    assert capsys.readouterr().out.count("removed") == len(DESTINATIONS) - 1
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == before
    assert main(["service", "remove", "--root", str(tmp_path)]) == 0
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert left == [tmp_path / DESTINATIONS["hapticd.toml"]]
    assert "systemctl daemon-reload" in capsys.readouterr().out


def test_an_enabled_service_keeps_its_unit(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    install(files(), tmp_path)
    wants = tmp_path / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir()
    (wants / "hapticd.service").symlink_to("/etc/systemd/system/hapticd.service")
    assert main(["service", "remove", "--root", str(tmp_path)]) == 1
    assert "run `systemctl disable --now hapticd` before" in capsys.readouterr().err
    assert (tmp_path / DESTINATIONS["hapticd.service"]).exists()


def test_nothing_installed_is_nothing_to_remove(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["service", "remove", "--root", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"nothing of hapticd's service is below {tmp_path}\n"
