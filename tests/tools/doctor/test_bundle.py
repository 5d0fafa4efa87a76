"""The bundle: its contents, no secrets, and refused paths."""

from __future__ import annotations

import json
import stat
import tarfile
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.config import loader as config
from hapticd.config.sections import Config
from hapticd.errors import RecordingError
from hapticd.io.clients import keys
from hapticd.tools.doctor import bundle
from hapticd.tools.doctor.bundle import collect
from hapticd.tools.doctor.finding import PASS, CheckResult, System

NOWHERE = Path("/nowhere")
FOUND = [CheckResult(PASS, "simulated", check="board")]


def members(path: Path) -> dict[str, bytes]:
    """Names within the bundle's one folder, and what they hold."""
    contents = {}
    with tarfile.open(path) as archive:
        for member in archive.getmembers():
            file = archive.extractfile(member)
            assert file is not None
            assert member.name.startswith(f"{path.name.removesuffix('.tar.gz')}/")
            contents[Path(member.name).name] = file.read()
    return contents


@pytest.fixture(autouse=True)
def _recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A recording that is made at once, and a log of one line."""

    def record(out: Path, directory: Path | None, seconds: float | None, **_: object) -> str:
        if directory == NOWHERE:
            raise RecordingError("No hapticd answers here.")
        out.write_bytes(f"{seconds:g} s of {directory}".encode())
        return "recorded"

    monkeypatch.setattr(bundle.attach, "record", record)
    monkeypatch.setattr(bundle, "journal", lambda: "a line\n")


def test_with_a_running_daemon_it_has_status_and_recording(tmp_path: Path) -> None:
    path = tmp_path / "report.tar.gz"
    listing = collect(path, System(Config(), tmp_path, {"state": "ACTIVE"}), None, FOUND)
    held = members(path)
    assert held["recording.mcap"] == f"10 s of {tmp_path}".encode()
    assert json.loads(held["status.json"]) == {"state": "ACTIVE"}
    assert held["doctor.txt"] == b"pass  board: simulated\n"
    assert held["log.txt"] == b"a line\n"
    assert json.loads(held["doctor.json"])["failed"] is False
    assert all(name in held["versions.txt"] for name in (b"hapticd ", b"python 3", b"zeromq ", b"numpy "))
    assert "nothing was sent" in listing
    assert all(name in listing for name in held)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert "no recording: No hapticd answers here." in collect(path, System(Config(), NOWHERE, {}), None, FOUND)
    assert "status.json" in members(path)


def test_no_secret_key_is_in_it_even_where_one_was_pasted_into_the_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "keys"
    _, secret_file = keys.make_pair(folder, keys.DAEMON_NAME)
    public_file, _ = keys.make_pair(tmp_path, "study-7")
    keys.allow(folder, public_file)
    secret = keys.load(folder).secret
    given = tmp_path / "hapticd.toml"
    given.write_text(
        f'# secret-key = "{secret.decode()}"\n# secret: {secret.decode()}\n'
        f'[client]\ntcp = "127.0.0.1:7410"\nkeys_dir = "{folder}"\n',
        encoding="utf-8",
    )
    path = tmp_path / "report.tar.gz"
    monkeypatch.setattr(bundle, "journal", secret_file.read_text)
    collect(path, System(config.load(given), tmp_path), given, FOUND)
    held = members(path)
    assert secret not in b"".join(held.values())
    assert b"(redacted)" in held["hapticd.toml"]
    assert b"(redacted)" in held["log.txt"]
    assert str(folder).encode() in held["in-force.toml"]


def test_without_a_daemon_it_gives_the_reason_for_the_missing_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tmp_path / "hapticd.toml"
    given.write_text("[limits]\nw_limit = 3\n", encoding="utf-8")
    path = tmp_path / "report.tar.gz"
    assert main(["doctor", "--config", str(given), "--bundle", str(path)]) == 1
    assert "no recording: no daemon answered" in capsys.readouterr().out
    held = members(path)
    assert held["hapticd.toml"] == given.read_bytes()
    assert b"did you mean w_limit_um?" in held["doctor.txt"]
    assert "recording.mcap" not in held
