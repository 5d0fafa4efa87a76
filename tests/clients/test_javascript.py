"""hapticd.js in Node, by a gateway to a daemon without a plate."""

from __future__ import annotations

import json
import re
import runpy
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest
from fake_daemon import FakeDaemon
from gateway_process import JAVASCRIPT, gateway_process, node_command, run_node

from hapticd.core.friction import DEFAULT_FRICTION_CURVE

SCHEMA = Path(__file__).parents[2] / "clients" / "schema"
CONNECT = "const plate = await hapticd.connect(process.argv[2], { ttlS: 1.5, timeoutS: 30 });\n"


def node(daemon: FakeDaemon, script: str) -> str:
    with gateway_process(daemon.directory) as address:
        return run_node(CONNECT + script, address)


def test_the_types_follow_from_the_contract() -> None:
    """`python clients/schema/write.py` writes them."""
    text = (JAVASCRIPT / "hapticd.d.ts").read_text(encoding="utf-8")
    assert runpy.run_path(str(SCHEMA / "typescript.py"))["with_types"](text) == text


def test_a_refused_change_throws_and_changes_nothing(daemon: FakeDaemon) -> None:
    printed = node(
        daemon,
        """
        const told = [];
        await plate.set("nobody", { friction: 0.2 }).catch((error) => told.push(error));
        await plate.virtual("a", { path_mm: [[0, 0]] });
        await plate.set("a", { friction: 2 }).catch((error) => told.push(error));
        await plate.set("a", { friction: 0.5 });
        console.log(JSON.stringify(told.map((error) => [error instanceof hapticd.RefusedError, error.message])));
        await plate.close();
        await plate.marker("late").catch((error) => console.log(error.name));
        """,
    )
    (first, second), last = json.loads(printed.splitlines()[0]), printed.splitlines()[1]
    assert first == [True, "body.targets[0].finger: this message defines no virtual finger 'nobody'."]
    assert second == [True, "body.targets[0].friction: 2 is out of bounds, it must be 0 .. 1."]
    assert last == "GoneError"


def test_bytes_are_sent_and_received_as_they_are(daemon: FakeDaemon) -> None:
    printed = node(
        daemon,
        """
        const levels = Uint8Array.from([0, 255, 128, 7]);
        const map = { width: 2, height: 2, levels, high_um: 2 };
        await plate.surface("picture", { map, rectangle_mm: [20, 20] });
        console.log([...hapticd.bytesOf("AP+ABw==")].join());
        const { surfaces } = await plate.request("surfaces");
        console.log([...hapticd.bytesOf(surfaces[0].map.levels)].join());
        await plate.close();
        """,
    )
    assert printed.split() == ["0,255,128,7", "0,255,128,7"]


def test_the_readme_s_program_runs_as_printed_in_a_copy_of_the_folder(daemon: FakeDaemon, tmp_path: Path) -> None:
    folder = tmp_path / "javascript"
    shutil.copytree(JAVASCRIPT, folder)
    blocks = dict(re.findall(r"```(js|sh)\n(.*?)```", (folder / "README.md").read_text("utf-8"), re.DOTALL))
    program = blocks["js"].replace("process.argv[2]", "process.argv[2], { timeoutS: 30 }")  # of a busy computer
    (folder / "program.js").write_text(program, encoding="utf-8")
    daemon.fingers = {1: (0.0, 0.0)}
    command = shlex.split(blocks["sh"])
    assert node_command()[-1] in command
    with (
        gateway_process(daemon.directory) as address,
        subprocess.Popen([*command[:-1], address], cwd=folder, stdout=subprocess.PIPE, text=True) as started,
    ):
        assert started.stdout is not None
        printed = started.stdout.readline()
        felt_um = daemon.felt_um(0.0)
        started.kill()
    assert printed == "1 0 null\n"
    assert felt_um == pytest.approx(DEFAULT_FRICTION_CURVE.amplitude_um(0.05))
