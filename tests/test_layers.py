"""Who may import whom, held by reading the imports."""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from hapticd.__main__ import COMMANDS
from hapticd.bench.command import PARTS

PACKAGE = Path(__file__).parents[1] / "hapticd"
CLIENT = Path(__file__).parents[1] / "clients" / "python" / "hapticd_client"
CONTRACT = CLIENT.with_name("hapticd_contract")
STUDY = Path(__file__).parents[1] / "clients" / "study"

VALUES = {"values", "board_values", "board_protocol", "errors"}  # and hapticd_contract
PROGRAM = {*VALUES, "formats", "config", "core", "wire", "io", "files", "daemon", "design", "sim", "__version__"}

# What each part may import of ours, apart from itself.
ALLOWED: dict[str, set[str]] = {
    "values": set(),
    "errors": set(),
    "regular_file": {"errors"},
    "board_protocol": set(),
    "board_values": {"values", "board_protocol"},
    "compiled": {"errors"},
    "formats": {*VALUES, "regular_file"},
    "config": {"errors", "formats"},
    "core": {*VALUES, "formats"},
    "wire": VALUES,
    "io": {*VALUES, "regular_file", "wire.trackpad"},
    "files": {
        *VALUES,
        "regular_file",
        "formats",
        "config",
        "core.plate",
        "wire",
        "__version__",
    },
    "design": {*VALUES, "core.friction", "core.plate", "core.solver"},
    "daemon": {*VALUES, "config", "core", "wire", "io", "files", "__version__"},
    "sim": {*VALUES, "regular_file", "formats", "config", "core", "wire", "design", "files", "daemon"},
    "tools": {*PROGRAM, "regular_file"},
    "bench": {*PROGRAM, "tools", "compiled", "regular_file"},
}
FORBIDDEN_IN_CORE = {"asyncio", "time", "socket", "logging", "os", "threading", "random", "zmq", "serial", "pathlib"}


def module_of(path: Path) -> str:
    name = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
    return name.removesuffix(".__init__")


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported_names(path: Path, *, at_load: bool = False) -> set[str]:
    """Absolute dotted names of the imports in a file; relative ones are resolved within hapticd.

    `at_load`: only those that are carried out when the module is imported, not those within functions.
    """
    relative = path.relative_to(PACKAGE.parent).with_suffix("")
    package = list(relative.parts[:-1])
    names: set[str] = set()
    tree = parsed(path)
    for node in tree.body if at_load else ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level > 0 else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            names.add(stem)
            names.update(f"{stem}.{alias.name}" for alias in node.names)
    return names


@cache
def named_modules(path: Path, root: Path = PACKAGE) -> set[str]:
    """Absolute dotted names of modules of hapticd that a file names by a string: to import or to run them.

    `import_module(".name", __package__)` is resolved within hapticd, and `-m hapticd COMMAND` is the command's module.
    """
    package = ".".join(path.relative_to(root.parent).parts[:-1])
    names: set[str] = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
            names |= {text} if re.fullmatch(r"hapticd(\.\w+)+", text) else set()
            names |= {f"{package}{text}"} if re.fullmatch(r"(\.\w+)+", text) else set()
        if isinstance(node, ast.List | ast.Tuple):
            words = [word.value if isinstance(word, ast.Constant) else None for word in node.elts]
            for option, program, command in zip(words, words[1:], words[2:], strict=False):
                if (option, program) == ("-m", "hapticd") and command in COMMANDS:
                    names.add(f"hapticd.{COMMANDS[str(command)].module}")
    return {name for name in names if is_module(name)}


def is_module(name: str) -> bool:
    path = PACKAGE.parent.joinpath(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def ours(names: set[str]) -> set[str]:
    return {name.removeprefix("hapticd.") for name in names if name.startswith("hapticd.")}


def part_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def layer_files() -> list[Path]:
    return sorted(path for path in PACKAGE.rglob("*.py") if part_of(path) not in ("__init__", "__main__"))


def test_a_part_imports_only_what_it_may() -> None:
    for path in layer_files():
        allowed = {part_of(path), *ALLOWED[part_of(path)]}
        for name in ours(imported_names(path) | named_modules(path)):
            assert any(
                name == part or name.startswith(part + ".") or part.startswith(name + ".") for part in allowed
            ), f"{path.relative_to(PACKAGE)} imports {name}"


def test_no_arrow_between_parts_runs_back_up() -> None:
    assert_no_circle({part: {name.split(".")[0] for name in allowed} for part, allowed in ALLOWED.items()})


def assert_no_circle(graph: dict[str, set[str]]) -> None:
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_no_two_modules_import_each_other_in_a_circle() -> None:
    modules = {module_of(path): path for path in PACKAGE.rglob("*.py")}
    graph: dict[str, set[str]] = {}
    for module, path in modules.items():
        needed = ours(imported_names(path))
        graph[module] = {name for name in needed if name in modules and name != module}
        graph[module] -= {package for package in graph[module] if modules[package].name == "__init__.py"}
    assert_no_circle(graph)


@pytest.mark.parametrize(("part", "least"), [("core", 7), ("io", 3), ("sim", 4)])
def test_no_two_wings_of_a_part_import_each_other(part: str, least: int) -> None:
    wings = sorted(path.name for path in (PACKAGE / part).iterdir() if (path / "__init__.py").exists())
    assert len(wings) >= least
    graph: dict[str, set[str]] = {}
    for wing in wings:
        names = {name for path in (PACKAGE / part / wing).glob("*.py") for name in ours(imported_names(path))}
        graph[wing] = {other for other in wings if other != wing and any(f"{part}.{other}" in name for name in names)}
    assert_no_circle(graph)


def test_the_core_imports_no_clock_socket_file_or_log() -> None:
    for path in (PACKAGE / "core").rglob("*.py"):
        assert not {name.split(".")[0] for name in imported_names(path)} & FORBIDDEN_IN_CORE, path


def test_clients_share_nothing_with_the_daemon_but_the_contract() -> None:
    rules = ((CLIENT, {"hapticd"}), (CONTRACT, {"hapticd", "hapticd_client"}), (STUDY, {"hapticd"}))
    for folder, forbidden in rules:
        files = list(folder.rglob("*.py"))
        assert files
        for path in files:
            assert not forbidden & {name.split(".")[0] for name in imported_names(path)}, path


def test_the_contract_is_imported_where_messages_and_what_they_bring_are_dealt_with() -> None:
    for path in layer_files():
        is_allowed = "values" in ALLOWED[part_of(path)] or part_of(path) in VALUES
        roots = {name.split(".")[0] for name in imported_names(path)}
        assert is_allowed or "hapticd_contract" not in roots, path


@pytest.mark.parametrize(
    ("libraries", "parts"),
    [
        ({"aiohttp"}, ("tools/gateway", "tools/view", "tools/web")),
        ({"pylsl"}, ("tools/record/inlets",)),
        ({"lz4", "mcap"}, ("files/recording/mcap_",)),
        ({"distributed"}, ("tools/campaigns",)),
        ({"scipy"}, ("bench", "design/section", "design/glued_plate", "tools/calibrate")),
        ({"evdev"}, ("io/devices/input_nodes",)),
        ({"h5py", "pyarrow"}, ("tools/record/export",)),
        ({"pythonosc"}, ("wire/osc",)),
        ({"hapticd_study"}, ("tools/study",)),
    ],
)
def test_a_heavy_library_is_imported_where_it_is_needed_alone(libraries: set[str], parts: tuple[str, ...]) -> None:
    for path in PACKAGE.rglob("*.py"):
        roots = {name.split(".")[0] for name in imported_names(path)}
        is_allowed = str(path.relative_to(PACKAGE)).startswith(parts)
        assert is_allowed or not roots & libraries, path


def test_code_that_only_tests_use_is_in_tests() -> None:
    """Commands and calibration steps are found by their folders; all else is imported or run by something."""
    found_by_folder = ("tools.calibrate.", "compiled.", "sim.plate.make_stored")
    commands, benches = {command.module for command in COMMANDS.values()}, {f"bench.{part}" for part in PARTS}
    used = {
        name.removeprefix("hapticd.")
        for path in PACKAGE.rglob("*.py")
        for name in (imported_names(path) | named_modules(path)) - {f"hapticd.{module_of(path)}"}
    }
    modules = {module_of(path).removeprefix("hapticd.") for path in layer_files() if path.name != "__init__.py"}
    lone = {name for name in modules - used - commands - benches if not name.startswith(found_by_folder)}
    assert lone == set()
    assert benches <= modules


# Names that others call (two decoders), and that each of two protocols has for its own request.
HOMONYMS = {"Decoder", "HelloRequest"}


@pytest.mark.parametrize("house", [(PACKAGE, CONTRACT), (CLIENT, CONTRACT)], ids=("daemon", "client"))
def test_a_public_type_has_one_meaning(house: tuple[Path, ...]) -> None:
    """A class or an alias that two modules define has two meanings: it is imported, renamed, or private (`_Name`)."""
    found: dict[str, list[str]] = {}
    for path in (path for part in house for path in sorted(part.rglob("*.py"))):
        for node in parsed(path).body:
            if isinstance(node, ast.Assign) and "TypeVar(" in ast.unparse(node.value):
                continue
            targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
            named = [target.id for target in targets if isinstance(target, ast.Name)]
            for name in [node.name] if isinstance(node, ast.ClassDef) else named:
                if re.match(r"[A-Z][a-z]", name):
                    found.setdefault(name, []).append(str(path.relative_to(PACKAGE.parent)))
    assert {name: paths for name, paths in found.items() if len(paths) > 1 and name not in HOMONYMS} == {}
