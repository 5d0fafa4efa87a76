"""The layer diagram, held by reading the imports: who may know whom."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "hapticd"
CLIENT = Path(__file__).parents[1] / "clients" / "python" / "hapticd_client"

VALUES = ("values", "board_values")
CONFIG = ("config", "config_sections")

# What each part may import of ours. `config` is plain values; `machine` is the daemon without its sockets.
ALLOWED = {
    "values": set(),
    "board_values": {"values"},
    "tool_values": {"values", "board_values"},
    "errors": set(),
    "tap": set(),
    "board_peer": {*VALUES, "tool_values", "errors", "config_sections", "core", "wire", "tap"},
    "client_peers": {"__version__", "values", "errors", "core", "wire", "tap"},
    "toml_file": {"errors"},
    "config_keys": {"errors", "toml_file"},
    "config_sections": {"config_keys"},
    "config": {"config_keys", "config_sections", "errors", "toml_file"},
    "core": {*VALUES, "errors", "core"},
    "wire": {*VALUES, "tool_values", "errors", "wire"},
    "io": {*VALUES, "errors", "io"},
    "design": {*VALUES, "errors", "core.modes", "design"},
    "viewer": {
        "errors",
        *CONFIG,
        "daemonprocess",
        "core.modes",
        "design.achievability",
        "wire.fields",
        "sim",
        "viewer",
    },
    "sim": {*VALUES, "tool_values", "errors", "core.modes", "core.neighbours", "wire", "design", "sim"},
    "study": {"errors", "daemonprocess", "study"},  # a client: it knows the daemon by the client library, or starts one
    "streams": {"errors", "streams"},  # clients too
    "doctor": {
        *("__version__", "errors", *CONFIG, "calibration", "installation", "service", *VALUES, "io", "bringup"),
        *("wire.trackpad", "recording.attach", "doctor"),
    },
    "recording": {
        *("__version__", *VALUES, "errors", *CONFIG, "toml_file", "core", "wire", "machine", "tap", "recording"),
    },
}
ALLOWED_FOR_FILE = {
    # The lock-step run turns the same wiring as the daemon, in virtual time: it alone may know it.
    "sim/lockstep.py": {"machine", "tap", *CONFIG, "core.solver"},
    "design/achievability.py": {"core.solver"},  # its map is what that gives
    "recording/service.py": {"io.record_socket"},
    "recording/attach.py": {"io.record_socket", "io.runtime_dir"},
    "recording/picture.py": {"sim.picture"},
    "recording/simulated.py": {"sim.lockstep"},
    "recording/whatif.py": {"sim.score"},
    "study/run.py": {"__version__"},
    "study/simulated.py": {"sim", *VALUES},  # it feels what that plate truly does
}
# What a daemon that records takes along: neither the rig nor a library of an extra.
TAKEN_ALONG = ("files", "framing", "header", "records", "service", "stream", "wanted", "writer")
FORBIDDEN_IN_CORE = {"asyncio", "time", "socket", "logging", "os", "pathlib", "threading", "random", "zmq", "serial"}
# `core.modes` reads and writes mode-shape files: `.load(path)` and `.save(path)` are names that others call.
EXCUSED_IN_CORE = {"core/modes.py": {"pathlib"}}


def imported_names(path: Path) -> set[str]:
    """Absolute dotted names of all imports in a file; relative ones are resolved within hapticd."""
    relative = path.relative_to(PACKAGE.parent).with_suffix("")
    package = list(relative.parts[:-1])
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level > 0 else []
            stem = ".".join([*base, *([node.module] if node.module else [])])
            names.add(stem)
            names.update(f"{stem}.{alias.name}" for alias in node.names)
    return names


def ours(names: set[str]) -> set[str]:
    return {name.removeprefix("hapticd.") for name in names if name.startswith("hapticd.")}


def layer_files() -> list[Path]:
    files = [path for path in PACKAGE.rglob("*.py") if path.relative_to(PACKAGE).parts[0] in {*ALLOWED}]
    return files + [path for path in PACKAGE.glob("*.py") if path.stem in ALLOWED]


@pytest.mark.parametrize("path", layer_files(), ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_layer_imports_only_what_it_may_know(path: Path) -> None:
    relative = path.relative_to(PACKAGE)
    allowed = ALLOWED[relative.parts[0].removesuffix(".py")] | ALLOWED_FOR_FILE.get(str(relative), set())
    for name in ours(imported_names(path)):
        assert any(name == part or name.startswith(part + ".") or part.startswith(name + ".") for part in allowed), (
            f"{relative} imports {name}"
        )


@pytest.mark.parametrize("path", sorted((PACKAGE / "core").glob("*.py")), ids=lambda path: path.name)
def test_the_core_knows_no_clock_socket_file_or_log(path: Path) -> None:
    roots = {name.split(".")[0] for name in imported_names(path)}
    excused = EXCUSED_IN_CORE.get(str(path.relative_to(PACKAGE)), set())
    assert not roots & (FORBIDDEN_IN_CORE - excused)


def test_no_part_of_the_daemon_knows_the_calibration() -> None:
    """Only the command line does, and that imports its arguments alone."""
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] not in ("calibrate", "__main__.py"):
            assert not any(name.startswith("calibrate") for name in ours(imported_names(path))), path
    arguments = ast.parse((PACKAGE / "calibrate" / "arguments.py").read_text(encoding="utf-8"))
    at_import = [node for node in arguments.body if isinstance(node, ast.ImportFrom) and node.level > 0]
    assert not at_import


def test_the_client_shares_no_code_with_the_daemon() -> None:
    files = list(CLIENT.glob("*.py"))
    assert files
    for path in files:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]
        for node in imports:
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            assert not any(module == "hapticd" or module.startswith("hapticd.") for module in modules), path


@pytest.mark.parametrize("name", TAKEN_ALONG)
def test_what_records_within_the_daemon_knows_no_simulation(name: str) -> None:
    names = imported_names(PACKAGE / "recording" / f"{name}.py")
    assert not any(one.startswith("hapticd.sim") for one in names)
    assert not {one.split(".")[0] for one in names} & {"h5py", "pyarrow", "matplotlib"}


def test_only_the_viewer_and_the_study_know_of_a_web_server() -> None:
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] not in ("viewer", "study"):
            assert "aiohttp" not in {name.split(".")[0] for name in imported_names(path)}, path


def test_libraries_of_streams_are_imported_by_streams_alone() -> None:
    for path in PACKAGE.rglob("*.py"):
        roots = {name.split(".")[0] for name in imported_names(path)}
        assert path.parent.name == "streams" or not roots & {"prometheus_client", "pylsl"}, path


def test_the_touch_path_never_imports_scipy() -> None:
    for path in PACKAGE.rglob("*.py"):
        if path.relative_to(PACKAGE).parts[0] in ("bench", "calibrate", "study"):
            continue
        assert "scipy" not in {name.split(".")[0] for name in imported_names(path)}, path
