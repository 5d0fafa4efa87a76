"""The front door says nothing untrue that a machine could notice."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from hapticd import __version__
from hapticd.__main__ import COMMANDS
from hapticd.config import loader as config
from hapticd.config.sections import Config

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
FOLDERS = sorted(path for top in ("hapticd", "firmware", "systemd") for path in (ROOT / top).rglob("README.md"))
ALL = {path: path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *FOLDERS)}
CHAPTERS = ("hapticd/core", "hapticd/daemon", "hapticd/sim", "hapticd/tools", "firmware")


def found(pattern: str) -> list[tuple[str, str]]:
    """Each match of `pattern` once per README that has it."""
    return sorted(
        {(str(path.relative_to(ROOT)), match) for path, text in ALL.items() for match in re.findall(pattern, text)}
    )


def test_the_front_page_has_at_most_170_lines_and_links_each_chapter_once() -> None:
    assert len(README.splitlines()) <= 170
    for folder in CHAPTERS:
        assert README.count(f"({folder}/README.md)") == 1, folder


@pytest.mark.parametrize(("readme", "path"), found(r"\]\(([^)#:]+)\)"))
def test_a_link_leads_somewhere(readme: str, path: str) -> None:
    assert (ROOT / readme).parent.joinpath(path).exists()


@pytest.mark.parametrize(
    ("readme", "key"),
    [(readme, key) for readme, key in found(r"`([a-z]+\.[a-z_]+)`") if hasattr(Config(), key.split(".")[0])],
)
def test_a_key_that_is_named_is_one(readme: str, key: str) -> None:
    section, name = key.split(".")
    assert name in ("py", "md", "c") or hasattr(getattr(Config(), section), name), readme


def test_its_configuration_is_accepted(tmp_path: Path) -> None:
    (tmp_path / "modes.npz").write_bytes(b"")
    for block in re.findall(r"```toml\n(.*?)```", ALL[ROOT / "hapticd/daemon/README.md"], flags=re.DOTALL):
        config.from_table(tomllib.loads(block), where="README.md", folder=tmp_path)


def test_its_first_clients_are_ten_lines_of_python_that_compile() -> None:
    blocks = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        assert len(block.strip().splitlines()) <= 10
        compile(block, "README.md", "exec")


def test_a_command_that_is_named_exists() -> None:
    assert {name for _, name in found(r"(?:bin/|`)hapticd ([a-z-]+)")} <= set(COMMANDS)


def test_the_make_targets_that_are_named_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for readme, target in found(r"(?m)(?:`|^)make ([a-z]+[a-z-]*)"):
        own = (ROOT / "firmware/Makefile").read_text(encoding="utf-8") if readme.startswith("firmware") else ""
        assert re.search(rf"^{target}:", makefile + own, re.MULTILINE), f"{readme}: make {target}"


def test_the_citation_is_of_this_version_and_of_the_paper_that_the_front_page_links() -> None:
    citation = (ROOT / ".github/CITATION.cff").read_text(encoding="utf-8")
    (paper,) = re.findall(r"^\[paper\]: (.*)$", README, flags=re.MULTILINE)
    assert re.findall(r"^version: (.*)$", citation, flags=re.MULTILINE) == [__version__]
    assert re.findall(r'^    url: "(.*)"$', citation, flags=re.MULTILINE) == [paper]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["urls"]["Paper"] == paper
    assert project["authors"]
    assert "Topic :: Scientific/Engineering :: Human Machine Interfaces" in project["classifiers"]


WORDS = re.findall(
    r"(?m)^\| ([^|]+?) \| [^|]", ALL[ROOT / "hapticd/core/README.md"].partition("## Words")[2].partition("## ")[0]
)


@pytest.mark.parametrize("word", ["ultrasonic", "squeeze film", "peak to peak", "leak", "knot", "W_LIM", "gate"])
def test_a_newcomer_finds_each_word_in_the_glossary_that_the_front_page_links(word: str) -> None:
    assert word in WORDS
    assert "(hapticd/core/README.md#words)" in README


@pytest.mark.parametrize("word", ["ultrasonic", "squeeze\nfilm", "peak to peak", "*leak*"])
def test_the_front_page_says_its_physics_before_its_commands(word: str) -> None:
    assert word in README.partition("## Try it")[0]


@pytest.mark.long
def test_the_concept_figure_is_drawn_by_its_script(tmp_path: Path) -> None:
    command = [sys.executable, str(ROOT / ".github" / "concept.py"), str(tmp_path / "concept.png")]
    subprocess.run(command, check=True, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert (tmp_path / "concept.png").read_bytes().startswith(b"\x89PNG")


def test_what_a_recipe_names_is_there() -> None:
    """Paths from the root, or from `hapticd/`; a bare file's name lies next to one that the same recipe names."""
    recipes = (
        (ROOT / ".github/CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Six changes")[2].split("\n**")
    )
    assert len(recipes) == 7
    for recipe in recipes:
        named = re.findall(r"`((?:[\w.-]+/)*[\w-]+\.(?:py|h|c|md))`", recipe)
        places = [ROOT / name if (ROOT / name).parent.is_dir() else ROOT / "hapticd" / name for name in named]
        folders = {place.parent for place in places} | {ROOT / "tests/firmware"}
        for name, place in zip(named, places, strict=True):
            near = [folder / name for folder in folders] if "/" not in name else []
            assert place.stem == "NAME" or any(path.is_file() for path in (place, *near)), name
