"""Make what follows from core/protocol.h: `make -C firmware protocol`.

From the header's constants, enumerations, structures and comments it makes the host's module
(hapticd/board_protocol.py, which installation makes too, so no commit has it), the tables of PROTOCOL.md between their
marks, and the header's own hash.
"""

from __future__ import annotations

import re
import textwrap
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

FIRMWARE = Path(__file__).parent
HEADER, BOARD = FIRMWARE / "core" / "protocol.h", FIRMWARE / "board.h"
TEXT, MODULE = FIRMWARE / "PROTOCOL.md", FIRMWARE.parent / "hapticd" / "board_protocol.py"

CODES = {"uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "uint64_t": "Q", "float": "f"}
SHORT = {"uint8_t": "u8", "uint16_t": "u16", "uint32_t": "u32", "uint64_t": "u64", "float": "f32"}
LIMITS = {kind: ("0", f"0x{(1 << int(kind[4:-2])) - 1:X}") for kind in CODES if kind != "float"}
LIMITS["float"] = ("-3.4e38", "3.4e38")
FROM_BOARD = 0x80  # message types from here on are the board's
WIDTH = 120

# Messages whose values have another shape than their bytes: `board_values` has these, `wire` translates. The first have
# bounds that the host checks.
BOUNDED = {"SET_CONTROLLER", "SET_MODEL", "SET_WIRING", "HELLO"}
SHAPED = BOUNDED | {"REFERENCE", "STATUS", "CONTROLLER", "SWEEP_POINT", "TELEMETRY", "LOG"}
CLASSES = {"state": ("BoardState", "The firmware's state."), "verdict": ("CommandResult", "The result of a command.")}
FLAGS = {"status_flag": "STATUS", "feature": "FEATURE"}
REPEATED = {"reference": ("knots", "knot")}  # what follows a payload: the field that counts it, and its structure
COUNTS = {"HD_MODES": "M", "HD_MODES * HD_MODES": "M x M", "HD_LOG_ENTRIES": "8"}


@dataclass(frozen=True)
class Field:
    """A line of a structure. `count` is the text in brackets, "" without any."""

    kind: str
    name: str
    count: str
    comment: str

    @property
    def is_text(self) -> bool:
        return self.kind == "uint8_t" and self.count != ""

    @property
    def is_array(self) -> bool:
        return self.count != "" and not self.is_text

    @property
    def structure(self) -> str:
        """The name of a structure that it could be."""
        return self.kind.removeprefix("hd_wire_").removesuffix("_t")

    @property
    def meaning(self) -> str:
        """The enumeration that its number belongs to; "" without any."""
        found = re.search(r"enum hd_(\w+)", self.comment)
        return found[1] if found else ""


@dataclass(frozen=True)
class Member:
    """An enumerator."""

    name: str
    number: int
    literal: str
    comment: str


class Header:
    """protocol.h, parsed."""

    def __init__(self, text: str, board: str) -> None:
        code = re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)
        lines = [line for line in code.splitlines() if "define HD_PROTOCOL_HASH" not in line]
        self.hash = zlib.crc32(re.sub(r"\s+", "", "".join(lines)).encode())
        numbers = dict(re.findall(r"#define HD_(\w+) ([-\d][\w.]*)", code))
        self.numbers = {
            name: text.rstrip("u" if "x" in text else "uf") for name, text in numbers.items() if name != "MODES"
        }
        self.numbers["PROTOCOL_HASH"] = f"0x{self.hash:08X}"
        self.enumerations = {
            name: [Member(of, int(number, 0), number, _flat(comment)) for of, number, comment in _MEMBER.findall(body)]
            for name, body in re.findall(r"enum hd_(\w+) \{(.*?)\n\};", text + board, flags=re.DOTALL)
        }
        self.structures = {
            name: [Field(*parts[:3], _flat(parts[3])) for parts in _FIELD.findall(body)]
            for body, name in re.findall(
                r"typedef struct HD_PACKED \{(.*?)\n\} hd_wire_(\w+)_t;", text, flags=re.DOTALL
            )
        }
        self.messages = self.enumerations["message"]

    def number(self, structure: str) -> int:
        """The type of the message whose payload a structure is; -1 of those that are parts."""
        return next((of.number for of in self.messages if of.name.lower() == structure), -1)

    def bounds(self, field: Field) -> tuple[str, str] | None:
        """The literals of a field's bounds, if its comment has any."""
        number = r"(-?\w[\w.]*(?:(?<=e)-\d+)?)"
        found = re.search(rf"(?<![\w.]){number} \.\. {number}", field.comment)
        return (self._literal(found[1]), self._literal(found[2])) if found else None

    def _literal(self, text: str) -> str:
        sign, name = ("-" if text.startswith("-") else ""), text.lstrip("-").rstrip(".")
        return sign + (self.numbers[name.removeprefix("HD_")] if name.startswith("HD_") else name)

    def format(self, fields: list[Field]) -> str:
        """The struct format of fields; nested structures are spelled out."""
        return "".join(self._code(field) for field in fields)

    def _code(self, field: Field) -> str:
        nested = self.structures.get(field.structure)
        return f"{field.count}s" if field.is_text else CODES[field.kind] if nested is None else self.format(nested)


_MEMBER = re.compile(r"HD_[A-Z]+?_(\w+) = (\w+),(?:\s*/\*(.*?)\*/)?", re.DOTALL)
_FIELD = re.compile(r"(\w+) (\w+)(?:\[([\w* ]+)\])?;(?:[ \t]*/\*(.*?)\*/)?", re.DOTALL)


def _flat(comment: str) -> str:
    """A comment on one line, without the stars of its own lines."""
    return " ".join(re.sub(r"\n\s*\*", " ", comment).split())


# --- the host's module ------------------------------------------------------------------------------------------

TOP = '''"""The board's protocol, made of firmware/core/protocol.h by `make -C firmware protocol`: edit that.

A command or message whose value has the shape of its bytes is a class here, the others are in `board_values`. Layouts
are packed and little endian; those of structures with arrays end before the first, and MORE_... is what lies behind
the last. Bounds include their ends, and are those of the magnitude where a value is complex.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Final

Bounds = dict[str, tuple[float, float]]'''


def module(header: Header) -> str:
    """The text of hapticd/board_protocol.py."""
    plain = [of for of in header.messages if of.name not in SHAPED]
    blocks = [TOP, _constants(header)]
    for name, members in header.enumerations.items():
        blocks += _enumeration(name, members) if name != "message" else []
    nouns = {f"MSG_{of.name}": match[1] for of in header.messages if (match := re.match(_NOUN, of.comment))}
    blocks.append("# What a refusal calls each command that a VERDICT answers.\n" + _table("COMMANDS", nouns))
    blocks.append(
        'EMPTY: Final = struct.Struct("<")\n'
        + "\n".join(line for name, fields in header.structures.items() for line in _layout(header, name, fields))
    )
    blocks += [_value(header, of) for of in plain]
    blocks.append(_union("PlainCommand", [_class_name(of) for of in plain if of.number < FROM_BOARD]))
    blocks.append(_union("PlainMessage", [_class_name(of) for of in plain if of.number >= FROM_BOARD]))
    whole = blocks[0]
    for before, block in pairwise(blocks):
        is_class = any(re.match(r"class |@dataclass", one) for one in (before, block))
        whole += ("\n\n\n" if is_class else "\n\n") + block
    return whole + "\n"


_NOUN = r'"(.+?)": '


def _table(name: str, rows: Mapping[str, str]) -> str:
    return "\n".join([f"{name}: Final = {{", *(f"    {key}: {_quoted(text, key)}," for key, text in rows.items()), "}"])


def _quoted(text: str, key: str) -> str:
    parts = [part.replace("\\", "\\\\").replace('"', '\\"') for part in textwrap.wrap(text, WIDTH - len(key) - 10)]
    return ' "\n    "'.join(parts).join('""')


def _union(name: str, members: Sequence[str]) -> str:
    line = f"{name} = {' | '.join(members)}"
    return line if len(line) <= WIDTH else f"{name} = (\n    " + "\n    | ".join(members) + "\n)"


def _constants(header: Header) -> str:
    """Times in nanoseconds, as the host has them; the rest as it is."""
    lines = []
    for name, number in header.numbers.items():
        is_time = name.endswith("_US")
        lines.append(f"{name[:-2]}NS: Final = {int(number) * 1000}" if is_time else f"{name}: Final = {number}")
    return "\n".join([*lines, *(f"MSG_{of.name}: Final = 0x{of.number:02X}" for of in header.messages)])


def _enumeration(name: str, members: list[Member]) -> list[str]:
    """Flags by their names, laws by what a person calls them, of the others what each number means."""
    if name in FLAGS:
        return ["\n".join(f"{FLAGS[name]}_{of.name}: Final = {of.literal}" for of in members)]
    if name == "law":
        return ["\n".join(["LAWS: Final = {", *(f'    "{of.name.lower()}": {of.number},' for of in members), "}"])]
    texts = _table(f"{name}s".upper(), {str(of.number): of.comment.split(". ")[0] for of in members})
    if name not in CLASSES:
        return [texts]
    kind, doc = CLASSES[name]
    rows = [f"    {of.name} = {of.literal}" for of in members]
    return ["\n".join([f"class {kind}(Enum):", f'    """{doc}"""', "", *rows]), texts]


def _layout(header: Header, name: str, fields: list[Field]) -> list[str]:
    """A structure's layout, the names of its fields where a shaped message of the board has it, and its bounds."""
    first = next((at for at, field in enumerate(fields) if field.is_array), len(fields))
    last = next((at for at in range(first, len(fields)) if not fields[at].is_array), len(fields))
    lines = []
    for part, of in ((name, fields[:first]), (f"more_{name}", fields[last:])):
        if of:
            lines.append(f'{part.upper()}: Final = struct.Struct("<{header.format(of)}")')
            lines += _names(part, of) if name.upper() in SHAPED and header.number(name) >= FROM_BOARD else []
    bounds = _bounds(header, fields, is_sent=0 <= header.number(name) < FROM_BOARD)
    if bounds and header.number(name) >= 0 and name.upper() not in SHAPED - BOUNDED:
        lines.append(f"{name.upper()}_BOUNDS: Final[Bounds] = {{")
        lines += [*(f'    "{of}": ({low}, {high}),' for of, (low, high) in bounds.items()), "}"]
    return lines


def _names(part: str, fields: list[Field]) -> list[str]:
    names = [f'"{field.name}"' for field in fields]
    line = f"{part.upper()}_FIELDS: Final = ({', '.join(names)})"
    return [line] if len(line) <= WIDTH else [f"{part.upper()}_FIELDS: Final = (", *(f"    {of}," for of in names), ")"]


def _bounds(header: Header, fields: list[Field], *, is_sent: bool) -> dict[str, tuple[str, str]]:
    """The bounds of each value; without any in the comment those of its type, where the host sends it."""
    found: dict[str, tuple[str, str]] = {}
    for field in fields:
        if (name := _value_name(fields, field)) == "":
            continue
        nested = header.structures.get(field.structure, [])
        limits = header.bounds(field)
        if limits is None and nested:
            found |= _bounds(header, nested, is_sent=is_sent)
        elif limits is not None or (is_sent and not field.is_array and not field.meaning):
            found[name] = limits or LIMITS[field.kind]
    return found


def _value_name(fields: list[Field], field: Field) -> str:
    """The name of the value that a field is, or begins: the d of a phasor has its name, the q none."""
    for axis, other in ("dq", "qd"):
        if re.sub(rf"_{axis}(?=_|$)", f"_{other}", field.name) in {one.name for one in fields} - {field.name}:
            return re.sub(r"_d(?=_|$)", "", field.name) if axis == "d" else ""
    return field.name


def _class_name(of: Member) -> str:
    return ("Board" if of.number >= FROM_BOARD else "") + "".join(part.capitalize() for part in of.name.split("_"))


def _value(header: Header, of: Member) -> str:
    """The class of a message whose value has the shape of its bytes."""
    fields = header.structures.get(of.name.lower(), [])
    text = re.sub(_NOUN, "", of.comment)
    doc = textwrap.fill(f'"""{text[0].upper()}{text[1:]}."""', WIDTH, initial_indent="    ", subsequent_indent="    ")
    layout = of.name if fields else "EMPTY"
    has_bounds = _bounds(header, fields, is_sent=of.number < FROM_BOARD) != {}
    lines = ["@dataclass(frozen=True, slots=True)", f"class {_class_name(of)}:", doc, ""]
    lines += [
        f"    kind: ClassVar = MSG_{of.name}",
        f"    layout: ClassVar = {layout}",
        f"    bounds: ClassVar[Bounds] = {of.name}_BOUNDS" if has_bounds else "    bounds: ClassVar[Bounds] = {}",
    ]
    for field in fields:
        if field.is_array or field.structure in header.structures:
            raise SystemExit(
                f"{field.name} of {of.name}: messages with arrays or structures belong to SHAPED and board_values."
            )
        if name := _value_name(fields, field):
            kind = "complex" if name != field.name else "float" if field.kind == "float" else "int"
            lines.append(f"    {name}: {CLASSES[field.meaning][0] if field.meaning in CLASSES else kind}")
    return "\n".join(lines)


# --- the tables of PROTOCOL.md ----------------------------------------------------------------------------------


def tables(header: Header) -> dict[str, str]:
    """The tables by their marks."""
    found = {
        "host to board": _payloads(header, range(FROM_BOARD)),
        "board to host": _payloads(header, range(FROM_BOARD, 0x100)),
    }
    for name in ("state", "fault", "refusal", "reset_cause"):
        found[name] = _numbers(name, header.enumerations[name])
    found["event"] = _numbers("event", [*header.enumerations["event"], *header.enumerations["board_event"]])
    return found


def _payloads(header: Header, types: range) -> str:
    rows = ["| type | message | payload |", "|---|---|---|"]
    for of in header.messages:
        if of.number in types:
            fields = header.structures.get(of.name.lower(), [])
            rows.append(f"| 0x{of.number:02X} | {of.name} | {_payload(header, of.name.lower(), fields)} |")
    return "\n".join(rows)


def _payload(header: Header, name: str, fields: list[Field]) -> str:
    parts = [_described(header, field) for field in fields]
    if name in REPEATED:
        count, part = REPEATED[name]
        parts.append(f"`{count}` x ({', '.join(_described(header, field) for field in header.structures[part])})")
    return ", ".join(parts) or "none"


def _described(header: Header, field: Field) -> str:
    """A field as the tables show it: how many, its name, its type and its bounds."""
    times = f"{COUNTS[field.count]} x " if field.is_array else ""
    nested = header.structures.get(field.structure)
    if field.is_text:
        return f"`{field.name}` {field.count} bytes"
    limits = header.bounds(field)
    within = " ({} .. {})".format(*(limit.removesuffix(".0") for limit in limits)) if limits else ""
    if nested is None:
        return f"{times}`{field.name}` {SHORT[field.kind]}{within}"
    return f"{times}`{field.name}` ({', '.join(_described(header, part) for part in nested)}){within}"


def _numbers(name: str, members: list[Member]) -> str:
    rows = [f"| {of.number} | {of.name} | {of.comment} |" for of in members]
    return "\n".join([f"| {name.replace('_', ' ')} | | |", "|---|---|---|", *rows])


def text(before: str, header: Header) -> str:
    """PROTOCOL.md with its tables and the hash as the header has them."""
    for name, table in tables(header).items():
        begin, end = f"<!-- {name}: of core/protocol.h -->\n", "\n<!-- end -->"
        if begin not in before:
            raise SystemExit(f"PROTOCOL.md has no mark {begin.strip()!r}.")
        head, rest = before.split(begin)
        before = head + begin + "\n" + table + "\n" + rest[rest.index(end) :]
    return re.sub(r"0x[0-9a-f]{8} today", f"0x{header.hash:08x} today", before)


def made() -> dict[Path, str]:
    """Contents of the files that follow from the header, the header's own hash included."""
    source = HEADER.read_text(encoding="utf-8")
    header = Header(source, BOARD.read_text(encoding="utf-8"))
    hashed = re.sub(r"(#define HD_PROTOCOL_HASH) \w+", rf"\1 0x{header.hash:08x}u", source)
    return {HEADER: hashed, MODULE: module(header), TEXT: text(TEXT.read_text(encoding="utf-8"), header)}


def stale() -> dict[Path, str]:
    """The files that do not hold what follows from the header, and what they should hold."""
    return {
        path: content
        for path, content in made().items()
        if not path.exists() or path.read_text(encoding="utf-8") != content
    }


def write_module() -> None:
    """Write the host's module where it is not as the header makes it; what is committed stays."""
    if MODULE in (content := stale()):
        MODULE.write_text(content[MODULE], encoding="utf-8")


def main() -> None:
    for path, content in stale().items():
        path.write_text(content, encoding="utf-8")
        print(path.relative_to(FIRMWARE.parent))


if __name__ == "__main__":
    main()
