"""The contract, from three sides: its text, the daemon's decoder and the library must not disagree."""

from __future__ import annotations

import json
import math
import os
import re
import runpy
import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from hapticd.daemon import client_registry as client_registry
from hapticd.errors import RequestError
from hapticd.wire import client as wire
from hapticd_client import HapticdError, Map, RefusedError, endpoint, messages, target_set
from hapticd_client.checks import checked
from hapticd_client.endpoint import default_directory
from hapticd_contract.contents import Grating, Noise
from hapticd_contract.effects import Effect, Envelope, Pulse
from hapticd_contract.requests import UNREAD_REQUEST_ID, SetRequest
from hapticd_contract.states import FingerState
from hapticd_contract.surfaces import Surface, VirtualFinger
from hapticd_contract.targets import FingerTarget

SCHEMA = Path(__file__).parents[2] / "clients" / "schema"
TEXT = (Path(__file__).parents[2] / "clients" / "PROTOCOL.md").read_text(encoding="utf-8")
EXAMPLES = [(kind, json.loads(body)) for kind, body in re.findall(r"```json (\w+)\n(.*?)```", TEXT, re.DOTALL)]


def examples(kind: str) -> list[dict[str, Any]]:
    found = [body for of_kind, body in EXAMPLES if of_kind == kind]
    assert found
    return found


# --- the text ---------------------------------------------------------------------------------------------------


def test_the_texts_targets_are_understood() -> None:
    for example in examples("targets"):
        message = wire.decode_targets(msgpack.packb(example))
        assert len(message.targets) == len(example["targets"])


def test_the_texts_requests_are_understood() -> None:
    for example in examples("control"):
        request = wire.decode_request(msgpack.packb(example))
        assert type(request).__struct_config__.tag == example["op"]


def test_the_texts_reply_is_what_the_daemon_sends_and_what_the_library_raises() -> None:
    for example in examples("reply"):
        payload = wire.encode_error(example["id"], example["error"])
        assert msgpack.unpackb(payload) == example
        with pytest.raises(RefusedError, match="held by 'other'"):
            messages.read_reply(payload, example["id"])


def test_the_tables_of_fields_and_the_schemas_follow_from_the_contract() -> None:
    write = runpy.run_path(str(SCHEMA / "write.py"))
    assert write["with_tables"](TEXT) == TEXT
    schemas = {name: json.loads(text) for name, text in write["schemas"]().items()}
    for example in examples("telemetry"):
        assert {*example} <= {*schemas["telemetry"]["$defs"]["PlateState"]["properties"]}


def test_the_texts_state_has_the_fields_that_the_daemon_sends_and_the_library_reads() -> None:
    for example in examples("telemetry"):
        state = messages.decode_state(msgpack.packb(example))
        assert msgpack.unpackb(wire.encode_state(state)) == example
        assert {*example["fingers"][0]} == {*FingerState.__struct_fields__} if example["fingers"] else True


# --- the library and the daemon ---------------------------------------------------------------------------------

edges = st.sampled_from(
    [-1e-9, 0.0, 1e-9, 0.02, 0.0199, 0.1, 0.0999, 1.0, 1.0001, 5.0, 5.01, 1000.0, 1000.1, 2000.0, 2001.0]
)
any_number = edges | st.floats() | st.sampled_from([2 * math.pi, -2 * math.pi, 6.2832, math.nan, math.inf, -math.inf])
any_point = st.tuples(any_number, any_number)
any_content = st.one_of(
    st.builds(FingerTarget, st.integers(-1, 9), st.integers(-1, 4), friction=any_number),
    st.builds(FingerTarget, st.just(1), grating=st.builds(Grating, any_number, any_number, angle_rad=any_number)),
    st.builds(FingerTarget, st.just(1), noise=st.builds(Noise, any_number, any_number, any_number, any_number)),
    st.builds(
        Surface,
        name=st.text(st.characters(codec="utf-8"), max_size=34),
        amplitude_um=any_number,
        circle_mm=any_number | st.none(),
    ),
    st.builds(Surface, name=st.just("a"), friction=st.just(1), polygon_mm=st.lists(any_point, max_size=18)),
    st.builds(VirtualFinger, st.lists(any_point, max_size=3), any_number, name=st.just("a")),
    st.builds(Effect, name=st.just("a"), pulse=st.builds(Pulse, any_number, any_number, any_number | st.none())),
    st.builds(Effect, name=st.just("a"), envelope=st.builds(Envelope, st.lists(any_point, max_size=4), st.booleans())),
)
FIELDS = {FingerTarget: "targets", VirtualFinger: "virtuals", Surface: "surfaces", Effect: "effects"}


@given(any_content)
def test_what_the_library_takes_the_daemon_takes_and_nothing_else(content: Any) -> None:
    def taken(take: Callable[[], object]) -> bool:
        try:
            take()
        except (RefusedError, RequestError):
            return False
        return True

    payload = msgspec.msgpack.encode({"v": 1, "client": "c", FIELDS[type(content)]: [content]})
    assert taken(lambda: checked(content)) == taken(lambda: wire.decode_targets(payload))


CLICK = Effect.of(Pulse(1.0, 0.01))


@pytest.mark.parametrize(
    ("kind", "add", "sentence"),
    [
        ("targets", lambda s, n, ttl_s: s.with_target(FingerTarget(n + 1, friction=0.5), ttl_s), "release one"),
        ("virtuals", lambda s, n, ttl_s: s.with_virtual(VirtualFinger(((0, 0),), name=f"v{n}"), ttl_s), "release one"),
        ("surfaces", lambda s, n, ttl_s: s.with_surface(Surface(name=f"s{n}", friction=0.5), ttl_s), "remove one"),
        ("effects", lambda s, n, ttl_s: s.with_effect(replace(CLICK, name=f"e{n}"), ttl_s), "stop one"),
    ],
)
def test_a_full_client_is_understood_and_one_more_is_refused_before_it_is_sent(
    kind: str, add: Callable[[target_set.TargetSet, int, float], target_set.TargetSet], sentence: str
) -> None:
    most = 16
    full = target_set.TargetSet()
    for n in range(most):
        full = add(full, n, 0.2 + 0.1 * n)
    message = wire.decode_targets(full.payload("c", target_set.stamp_now()))
    assert (len(getattr(message, kind)), message.ttl_ns) == (16, 200_000_000)  # the shortest of all
    with pytest.raises(RefusedError, match=f"{sentence} first"):
        add(full, most, 0.5)
    assert not full.is_empty
    assert full.without(*full.targets, *full.virtuals).is_empty == (kind in ("targets", "virtuals"))


def test_what_the_library_just_takes_still_fits_a_request() -> None:
    targets, stamp = target_set.TargetSet(), target_set.stamp_now()
    for n in range(3):
        image = Map([[0] * 128] * 128, high_um=1.0).message
        targets = targets.with_target(FingerTarget(n + 1, map=image), ttl_s=0.5)
    room = target_set.MAX_MESSAGE_BYTES - 100 - len(targets.payload("c" * 32, stamp))
    side = math.isqrt(room - 120)
    image = Map([[0] * side] * side, high_um=1.0).message
    targets = targets.with_target(FingerTarget(4, map=image), ttl_s=0.5)
    assert len(targets.payload("c" * 32, stamp)) > target_set.MAX_MESSAGE_BYTES - 600
    request = messages.encode_request("set", 2**32 - 1, targets.message("c" * 32, stamp))
    assert isinstance(wire.decode_request(request), SetRequest)


# --- what comes back --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "change",
    [
        {"fingers": 3},
        {"events": [3]},
        {"events": [{}]},
        {"fingers": [3]},
        {"modal_um": None},
        {"age_ms": ...},
        {"v": 2},
    ],
)
def test_a_state_that_is_not_of_this_version_is_an_error(change: dict[str, Any]) -> None:
    example, *_ = examples("telemetry")
    changed = {name: value for name, value in (example | change).items() if value is not ...}
    with pytest.raises(HapticdError):
        messages.decode_state(msgpack.packb(changed))


def test_fields_of_a_newer_daemon_are_ignored() -> None:
    example, *_ = examples("telemetry")
    newer = example | {"mood": "good", "fingers": [finger | {"pressure": 1} for finger in example["fingers"]]}
    assert messages.decode_state(msgpack.packb(newer)) == messages.decode_state(msgpack.packb(example))


@pytest.mark.parametrize("fields", [{}, {"id": None}, {"id": "1", "ok": True}, {"id": True, "ok": True}])
def test_a_reply_to_no_request_is_none_of_the_daemon_s(fields: dict[str, Any]) -> None:
    with pytest.raises(HapticdError, match="does not use hapticd's protocol"):
        messages.read_reply(msgpack.packb(fields), 1)


def test_a_late_reply_is_not_mistaken_for_another() -> None:
    assert messages.read_reply(wire.encode_reply(7, {"a": 1}), 8) is None
    assert messages.read_reply(wire.encode_error(7, "late"), 8) is None
    assert messages.read_reply(wire.encode_reply(8, {"a": 1}), 8) == {"a": 1}
    with pytest.raises(RefusedError, match="unreadable"):
        messages.read_reply(wire.encode_error(UNREAD_REQUEST_ID, "unreadable"), 8)


# --- where the daemon is ----------------------------------------------------------------------------------------


def test_the_daemon_is_found_where_its_sockets_are(tmp_path: Path) -> None:
    mine, systems = tmp_path / "user" / "hapticd", tmp_path / "system"
    environ = {"XDG_RUNTIME_DIR": str(tmp_path / "user"), "RUNTIME_DIRECTORY": f"{systems}:/other"}
    assert default_directory(environ) == systems  # nowhere: the first place to look
    mine.mkdir(parents=True)
    with socket.socket(socket.AF_UNIX) as control:
        control.bind(str(mine / "control"))
        assert default_directory(environ) == mine
    assert default_directory(environ | {"HAPTICD_RUNTIME_DIR": "/there"}) == Path("/there")
    assert default_directory({}) in (Path(f"/tmp/hapticd-{os.getuid()}"), Path("/run/hapticd"))


def test_a_directory_in_tmp_that_others_may_have_made_is_not_trusted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(endpoint, "TEMPORARY", tmp_path)
    monkeypatch.setattr(endpoint, "SYSTEM_DIRECTORY", tmp_path / "system")
    mine = tmp_path / f"hapticd-{os.getuid()}"
    for place in (mine, tmp_path / "system"):
        place.mkdir(mode=0o755)
    with socket.socket(socket.AF_UNIX) as own, socket.socket(socket.AF_UNIX) as systems:
        own.bind(str(mine / "control"))
        assert default_directory({}) == mine
        for mode in (0o777, 0o775):
            mine.chmod(mode)
            with pytest.raises(HapticdError, match="a daemon there is not trusted: remove it"):
                default_directory({})
        mine.rename(tmp_path / "elsewhere").chmod(0o755)
        mine.symlink_to(tmp_path / "elsewhere")
        with pytest.raises(HapticdError, match="not trusted"):
            default_directory({})
        systems.bind(str(tmp_path / "system" / "control"))
        assert default_directory({}) == tmp_path / "system"


def test_what_a_daemon_says_cannot_command_the_terminal() -> None:
    reply = msgpack.packb({"v": 1, "id": 1, "ok": False, "error": "no \x1b]0;owned\x07 \x1b[2J µ"})
    with pytest.raises(RefusedError) as raised:
        messages.read_reply(reply, 1)
    assert str(raised.value) == r"no \x1b]0;owned\x07 \x1b[2J µ"
