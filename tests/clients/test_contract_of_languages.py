"""The same calls in Python, JavaScript, C and C# are the same to the daemon."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest
from asynchronous import PATIENCE_S
from c_client import FOLDER, SANITIZERS, compiled
from fake_daemon import FakeDaemon
from gateway_process import gateway_process, run_node
from msgspec import Struct
from msgspec.structs import replace

from hapticd.wire import client as wire
from hapticd_client import Circle, Client, Grating, Rectangle, RefusedError
from hapticd_contract import requests
from hapticd_contract.requests import OPS, Release
from hapticd_contract.targets import ClientTargets

REFUSAL = "friction: 1.5 is out of bounds, it must be 0 .. 1."
FINGERS = {1: (-20.5, 4.0), 2: (9.0, 0.25)}
CALLS = ["hello", *4 * ["set"], "marker", "release", "set", "release"]
CSHARP = Path(__file__).parents[2] / "clients/csharp/Hapticd.cs"
PRINTED = "fingers: 1 -20.5 4 1 2 9 0.25 1"
JAVASCRIPT = """
const plate = await hapticd.connect(process.argv[2], { name: "javascript", timeoutS: 30 });
await plate.set(1, { friction: 0.2 });
await plate.set(2, { grating: { period_mm: 4, high_um: 2, low_um: 0.5, angle_rad: 0.25, duty_frac: 0.5 } });
const patch = { amplitude_um: 1.25, rectangle_mm: [40, 20], position_mm: [10, -5], angle_rad: 0.5, z: 3 };
await plate.surface("patch", patch);
await plate.surface("disc", { friction: 0.1, circle_mm: 8 });
await plate.marker("trial 1");
await plate.set(1, { friction: 1.5 }).catch((error) => console.log(`refused: ${error.message}`));
let read = 0;
const state = await new Promise((resolve) => plate.follow((one) => ++read === 100 && resolve(one)));
const fingers = state.fingers.map((one) => [one.id, one.x_mm, one.y_mm, Number(one.target_um !== null)].join(" "));
console.log(["fingers:", ...fingers].join(" "));
await plate.release(1);
await plate.remove("patch");
await plate.close();
"""


class Witness(FakeDaemon):
    """Remembers what was asked of it, without what names a client and counts its messages."""

    def __init__(self, directory: Path) -> None:
        super().__init__(directory)
        self.fingers = dict(FINGERS)
        self.asked: list[tuple[str, object]] = []
        self.repeated: list[ClientTargets] = []

    def _handle(self, request: requests.Request, user: str) -> Struct | Mapping[str, object]:
        tag = str(request.__struct_config__.tag)
        assert tag in OPS
        body: Struct = request.body
        if isinstance(body, ClientTargets | Release):
            assert body.stamp is not None
            body = replace(body, stamp=None)
        self.asked.append((tag, replace(body, client="") if hasattr(body, "client") else body))
        return super()._handle(request, user)

    def _on_message(self, payload: bytes, user: str, waited_ns: int) -> None:
        message = wire.decode_targets(payload)
        fields = {name: getattr(message, name) for name in ClientTargets.__struct_fields__}
        self.repeated.append(ClientTargets(**{**fields, "client": "", "stamp": None}))
        super()._on_message(payload, user, waited_ns)


def by_python(daemon: Witness, _: Path) -> str:
    with Client(daemon.directory, name="python", timeout_s=30.0) as plate:
        plate.set(1, friction=0.2)
        plate.set(2, grating=Grating(4.0, 2.0, 0.5, 0.25, 0.5))
        patch = Rectangle(40.0, 20.0)
        plate.surface("patch", patch, amplitude_um=1.25, position_mm=(10.0, -5.0), angle_rad=0.5, z=3)
        plate.surface("disc", Circle(8.0), friction=0.1)
        plate.marker("trial 1")
        with pytest.raises(RefusedError) as refused:
            plate.set(1, friction=1.5)
        for _, state in zip(range(100), plate.states(PATIENCE_S), strict=False):
            fingers = [f"{one.id} {one.x_mm:g} {one.y_mm:g} {int(one.target_um is not None)}" for one in state.fingers]
        plate.release(1)
        plate.remove("patch")
    return "\n".join([f"refused: {refused.value}", " ".join(["fingers:", *fingers])])


def by_javascript(daemon: Witness, _: Path) -> str:
    with gateway_process(daemon.directory) as address:
        return run_node(JAVASCRIPT, address)


def by_c(daemon: Witness, folder: Path) -> str:
    script = Path(__file__).with_name("contract_script.c")
    made = compiled(folder, *SANITIZERS, str(script), str(FOLDER / "hapticd.c"))
    done = subprocess.run([made, str(daemon.directory), "c"], capture_output=True, text=True, timeout=PATIENCE_S * 4)
    assert done.returncode == 0, done.stderr
    return done.stdout


def by_csharp(daemon: Witness, folder: Path) -> str:
    compiler, runtime = shutil.which("mcs"), shutil.which("mono")
    if compiler is None or runtime is None:
        pytest.skip("mcs and mono are not installed (Debian: mono-mcs, mono-runtime)")
    program = folder / "script.exe"
    sources = [str(CSHARP), str(Path(__file__).with_name("ContractScript.cs"))]
    flags = ["-langversion:7", "-warn:4", "-warnaserror", "-r:System.dll", "-r:System.Core.dll", f"-out:{program}"]
    subprocess.run([compiler, *flags, *sources], check=True, timeout=PATIENCE_S * 4)
    with gateway_process(daemon.directory) as address:
        done = subprocess.run([runtime, program, address], capture_output=True, text=True, timeout=PATIENCE_S * 4)
    assert done.returncode == 0, done.stderr
    return done.stdout


def seen(language: Callable[[Witness, Path], str], folder: Path) -> Witness:
    daemon = Witness(folder)
    daemon.start()
    try:
        refused, fingers = language(daemon, folder).strip().splitlines()
    finally:
        daemon.stop()
    assert refused.startswith("refused: ")
    assert refused.endswith(REFUSAL)
    assert fingers == PRINTED
    assert daemon.refusals == []
    assert daemon.overtaken <= len(daemon.asked)  # by each request at most the refresh that is on its way
    return daemon


def steps(daemon: Witness) -> list[str]:
    """What was asked, in order: a refused `set` reaches the daemon of those who do not know bounds, which then ask for
    what was before."""
    asked = [json.dumps([tag, repr(body)]) for tag, body in daemon.asked]
    return [one for index, one in enumerate(asked) if index == 0 or one != asked[index - 1]]


@pytest.mark.parametrize("language", [by_javascript, by_c, by_csharp])
def test_the_same_script_of_calls_is_the_same_to_the_daemon(
    language: Callable[[Witness, Path], str], tmp_path: Path
) -> None:
    for name in ("python", "other"):
        (tmp_path / name).mkdir()
    python, other = seen(by_python, tmp_path / "python"), seen(language, tmp_path / "other")
    assert [tag for tag, _ in python.asked] == CALLS
    wanted = steps(other)
    again = wanted.pop(6)  # what was in force before the refused `set` is asked for once more
    assert again == steps(python)[4]
    assert wanted == steps(python)
    for daemon in (python, other):
        held = [body for tag, body in daemon.asked if tag == "set" and isinstance(body, ClientTargets)]
        whole = held[3]
        without_first = replace(whole, targets=whole.targets[1:])
        assert whole in daemon.repeated
        assert all(one in (*held, without_first, ClientTargets("")) for one in daemon.repeated)
