"""The front door says nothing untrue that a machine could notice."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from hapticd.__main__ import main
from hapticd.config import loader as config
from hapticd.config.sections import Config

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.DOTALL)


@pytest.mark.parametrize("path", sorted(set(re.findall(r"\]\(([^)#:]+)\)", README))))
def test_a_link_leads_somewhere(path: str) -> None:
    assert (ROOT / path).exists()


@pytest.mark.parametrize("key", sorted(set(re.findall(r"`([a-z]+\.[a-z_]+)`", README))))
def test_a_key_that_it_names_is_one(key: str) -> None:
    section, name = key.split(".")
    if name not in ("py", "md", "c"):
        assert hasattr(getattr(Config(), section), name)


def test_its_configuration_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "cartography.npz").write_bytes(b"")
    for block in blocks("toml"):
        config.from_table(tomllib.loads(block), where="README.md", folder=tmp_path)


def test_its_first_client_is_ten_lines_of_python_that_compile() -> None:
    (block,) = blocks("python")
    assert len(block.strip().splitlines()) <= 10
    compile(block, "README.md", "exec")


@pytest.mark.parametrize("command", sorted(set(re.findall(r"hapticd (demo|run|simulate|bench|doctor)\b", README))))
def test_a_command_that_it_names_exists_and_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    assert "example: hapticd " + command in capsys.readouterr().out


def test_the_make_targets_that_it_names_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"make (\w+)", README)) - {"are"}:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target
