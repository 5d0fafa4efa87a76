"""`firmware/core/protocol.h` is where the protocol is written: what follows from it is as it is made."""

from __future__ import annotations

import runpy
from pathlib import Path

from hapticd import board_protocol as protocol
from hapticd.wire import commands

MAKER = Path(__file__).parents[2] / "firmware" / "make_protocol.py"


def test_module_and_tables_are_those_that_the_header_makes() -> None:
    stale = [path.name for path in runpy.run_path(str(MAKER))["stale"]()]
    assert stale == [], "protocol.h has changed: run `make -C firmware protocol`"


def test_every_message_of_the_host_is_a_command_that_a_board_has_to_understand() -> None:
    types = [number for name, number in vars(protocol).items() if name.startswith("MSG_") and number < 0x20]
    assert sum(1 << number for number in types) == commands.ALL_COMMANDS
