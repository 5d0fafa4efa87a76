"""Keys: secrets stay secret, a name is a file name and nothing more, and without keys TCP is refused at start."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.errors import HapticdError
from hapticd.io.clients import keys


def filled(directory: Path) -> Path:
    """A daemon's directory that allows one client, with its key pair."""
    keys.make_pair(directory / "daemon", "hapticd")
    keys.make_pair(directory / "client", "study-7")
    keys.allow(directory / "daemon", directory / "client" / "study-7.key")
    return directory / "daemon"


def test_a_secret_is_readable_for_its_owner_only_whatever_the_umask(tmp_path: Path) -> None:
    umask = os.umask(0)
    try:
        public, secret = keys.make_pair(tmp_path / "new", "hapticd")
        assert stat.S_IMODE(secret.stat().st_mode) == 0o600
        assert stat.S_IMODE(public.stat().st_mode) == 0o644
        assert stat.S_IMODE(public.parent.stat().st_mode) == 0o700
        assert os.umask(0) == 0
    finally:
        os.umask(umask)


def test_a_key_in_use_is_never_overwritten(tmp_path: Path) -> None:
    _, secret = keys.make_pair(tmp_path, "hapticd")
    before = secret.read_bytes()
    with pytest.raises(HapticdError, match="its users need it"):
        keys.make_pair(tmp_path, "hapticd")
    assert secret.read_bytes() == before


@pytest.mark.parametrize("name", ["", "..", "../x", "a/b", ".hidden", "a" * 33, "a\n", "ü", "a b", "$(id)"])
def test_a_name_is_a_file_name_and_nothing_more(tmp_path: Path, name: str) -> None:
    for attempt in (keys.make_pair, keys.revoke):
        with pytest.raises(HapticdError, match=r"a key's name has 1 \.\. 32"):
            attempt(tmp_path / "deep" / "er", name)
    assert list(tmp_path.iterdir()) == []


def test_a_secret_is_not_taken_for_a_public_key(tmp_path: Path) -> None:
    directory = filled(tmp_path)
    keys.make_pair(tmp_path / "other", "eve")
    with pytest.raises(HapticdError, match="secret key"):
        keys.allow(directory, tmp_path / "other" / "eve.key_secret")
    assert list(keys.allowed(directory).values()) == ["study-7"]


def test_one_key_has_one_name_and_one_name_one_key(tmp_path: Path) -> None:
    directory = filled(tmp_path)
    again = tmp_path / "again.key"
    again.write_bytes((tmp_path / "client" / "study-7.key").read_bytes())
    with pytest.raises(HapticdError, match="already allowed as study-7"):
        keys.allow(directory, again)
    public, _ = keys.make_pair(tmp_path / "other", "study-7")
    with pytest.raises(HapticdError, match="another key has this name"):
        keys.allow(directory, public)


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda d: (d / "hapticd.key_secret").unlink(), "TCP needs keys: run `hapticd service keys"),
        (lambda d: (d / "hapticd.key_secret").chmod(0o640), "other users may read this secret"),
        (lambda d: (d / "hapticd.key_secret").write_text("hello"), "is not a ZeroMQ certificate"),
        (lambda d: (d / "hapticd.key_secret").write_text('public-key = "short"'), "is not a ZeroMQ certificate"),
        (lambda d: (d / "hapticd.key_secret").write_bytes((d / "hapticd.key").read_bytes()), "contains no secret key"),
        (lambda d: (d / "clients" / "study-7.key").unlink(), "no client is allowed"),
        (lambda d: (d / "clients" / "x.key").write_bytes(b'public-key = "' + b"\xff" * 40), "not a ZeroMQ certificate"),
    ],
)
def test_missing_or_invalid_keys_are_reported_in_one_sentence(tmp_path: Path, spoil: object, sentence: str) -> None:
    directory = filled(tmp_path)
    assert callable(spoil)
    spoil(directory)
    with pytest.raises(HapticdError, match=sentence):
        keys.load(directory)


def test_the_command_makes_allows_lists_and_revokes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    daemon, mine = str(tmp_path / "daemon"), str(tmp_path / "mine")
    assert main(["service", "keys", "make", daemon]) == 0
    assert main(["service", "keys", "make", mine, "study-7"]) == 0
    assert main(["service", "keys", "allow", daemon, f"{mine}/study-7.key"]) == 0
    capsys.readouterr()
    assert main(["service", "keys", "list", daemon]) == 0
    ((own, _), (name, public)) = (line.split() for line in capsys.readouterr().out.splitlines())
    assert (own, name) == ("hapticd", "study-7")
    assert keys.load(tmp_path / "daemon").clients == {public: "study-7"}
    assert main(["service", "keys", "revoke", daemon, "study-7"]) == 0
    assert main(["service", "keys", "revoke", daemon, "study-7"]) == 2
    assert "cannot be removed" in capsys.readouterr().err
