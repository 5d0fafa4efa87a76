"""The examples of property tests: fixed in `make test`, whatever the environment, and new ones only on request."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
SHOW = """
import json, os, runpy, hypothesis
def profile(**environ):
    for name in ("CI", "NEW_EXAMPLES"):
        os.environ.pop(name, None)
    os.environ.update(environ)
    runpy.run_path("tests/conftest.py")
    chosen = hypothesis.settings()
    return [chosen.derandomize, chosen.database is None, chosen.deadline is None]
print(json.dumps([profile(), profile(CI="1"), profile(NEW_EXAMPLES="1"), profile(NEW_EXAMPLES="1", CI="1")]))
"""


def shown(environ: dict[str, str]) -> list[list[bool]]:
    """Each profile's [examples are fixed, none are kept, time does not count]: alone, CI, NEW_EXAMPLES, both."""
    ran = subprocess.run([sys.executable, "-c", SHOW], cwd=ROOT, env=environ, capture_output=True, check=True)
    profiles: list[list[bool]] = json.loads(ran.stdout)
    return profiles


def test_examples_are_fixed_unless_new_ones_are_asked_for_with_and_without_ci() -> None:
    plain = {name: value for name, value in os.environ.items() if name not in ("CI", "NEW_EXAMPLES")}
    fixed, new = [True, True, True], [False, True, True]
    for environ in (plain, plain | {"CI": "1"}):  # hypothesis looks at it when it is imported
        assert shown(environ) == [fixed, fixed, new, new]


def test_make_test_asks_for_no_new_examples_and_make_test_all_for_those_of_every_property() -> None:
    recipes = (ROOT / "Makefile").read_text(encoding="utf-8").split("\n\n")
    test, test_all = (next(recipe for recipe in recipes if f"\n{name}: " in recipe) for name in ("test", "test-all"))
    assert "NEW_EXAMPLES=1" not in test
    assert 'NEW_EXAMPLES=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "hypothesis' in test_all
    assert '"long and not hypothesis and not alone"' in test_all  # a failure on a new example is never run again
