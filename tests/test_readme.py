"""Links, keys, commands and code that the READMEs name are there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from hapticd.__main__ import COMMANDS
from hapticd.config import loader as config
from hapticd.config.sections import Config

ROOT = Path(__file__).parents[1]
TOPS = ("hapticd", "firmware", "systemd", "clients", ".github")
TEXTS = {
    path: path.read_text(encoding="utf-8")
    for path in (ROOT / "README.md", *(path for top in TOPS for path in sorted((ROOT / top).rglob("*.md"))))
}


def found(pattern: str) -> set[tuple[Path, str]]:
    """Each match of `pattern` once per document that has it."""
    return {(path, match) for path, text in TEXTS.items() for match in re.findall(pattern, text)}


def test_each_link_leads_to_a_file() -> None:
    lost = [(path, link) for path, link in found(r"\]\(([^)#:]+)[)#]") if not (path.parent / link).exists()]
    assert lost == []


def test_each_key_of_the_configuration_that_is_named_exists() -> None:
    keys = [(path, *key.split(".")) for path, key in found(r"`([a-z]+\.[a-z_]+)`")]
    sections = {section: getattr(Config(), section) for _, section, _ in keys if hasattr(Config(), section)}
    lost = [
        (path, section, name)
        for path, section, name in keys
        if section in sections and name not in ("py", "md", "c") and not hasattr(sections[section], name)
    ]
    assert lost == []


def test_the_configurations_of_the_daemons_readme_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "modes.npz").write_bytes(b"")
    for block in re.findall(r"```toml\n(.*?)```", TEXTS[ROOT / "hapticd/daemon/README.md"], flags=re.DOTALL):
        config.from_table(tomllib.loads(block), where="README.md", folder=tmp_path)


def test_the_front_pages_python_compiles() -> None:
    for block in re.findall(r"```python\n(.*?)```", TEXTS[ROOT / "README.md"], flags=re.DOTALL):
        compile(block, "README.md", "exec")


def test_each_command_that_is_named_exists() -> None:
    lost = [(path, name) for path, name in found(r"(?:bin/|`)hapticd ([a-z][a-z-]+)") if name not in COMMANDS]
    assert lost == []
