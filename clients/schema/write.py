"""Writes what follows from the contract: the tables of `clients/PROTOCOL.md`, the types of the JavaScript client
(`typescript.py`), and, for a release, the JSON schemas.

`python clients/schema/write.py [FOLDER]`: with FOLDER it writes the schemas there. Tests compare tables and types.
Meanings are the docstrings behind the fields of `hapticd_contract`, values their types and bounds.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import runpy
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect as types

from hapticd_contract import contents, effects, replies, requests, states, surfaces, targets, web
from hapticd_contract.base import Contract

FOLDER = Path(__file__).parent
PROTOCOL = FOLDER.parent / "PROTOCOL.md"
TABLE = re.compile(r"(<!-- fields of ([\w. ]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
MODULES = (targets, contents, surfaces, effects, requests, replies, states, web)
SCHEMAS: dict[str, Any] = {
    "targets": targets.TargetsMessage,
    "control": requests.Request,
    "telemetry": states.PlateState,
    "follow": web.Follow,
    **{
        f"reply-{kind.__name__.lower()}": kind
        for kind in (
            *(replies.Hello, replies.Capabilities, replies.Released, replies.Have, replies.Marked, replies.Reach),
            *(replies.Surfaces, replies.Plate),
        )
    },
}


def main() -> None:
    """Write the tables and the types, and the schemas into a folder that is given."""
    for folder in map(Path, sys.argv[1:]):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in schemas().items():
            (folder / f"{name}.json").write_text(text, encoding="utf-8")
    PROTOCOL.write_text(with_tables(PROTOCOL.read_text(encoding="utf-8")), encoding="utf-8")
    runpy.run_path(str(FOLDER / "typescript.py"))["main"]()


# --- schemas ----------------------------------------------------------------------------------------------------


def schemas() -> dict[str, str]:
    """Return each message's JSON schema as text. Bytes are base64 there; MessagePack has them as they are."""
    return {name: json.dumps(_schema(kind), indent=1, ensure_ascii=False) + "\n" for name, kind in SCHEMAS.items()}


def _schema(kind: Any) -> dict[str, Any]:
    schema = msgspec.json.schema(kind)
    for name, definition in schema["$defs"].items():
        meanings = meanings_of(_struct(name))
        for field, form in definition.get("properties", {}).items():
            if meanings.get(field):
                form["description"] = meanings[field]
    return schema


# --- tables -----------------------------------------------------------------------------------------------------


def with_tables(text: str) -> str:
    """Return the document with its generated tables as the contract has them."""
    return TABLE.sub(lambda found: found[1] + _table(found[2].split()) + found[4], text)


def _table(names: list[str]) -> str:
    merged: list[list[str]] = [["field", "value", "meaning"], ["---", "---", "---"]]
    for field, value, meaning in (row for name in names for row in _rows(_struct(name))):
        if not meaning and value == merged[-1][1]:
            merged[-1][0] += f", {field}"
        else:
            merged.append([field, value, meaning])
    lines = (f"| {field} | {value} | {meaning} |" for field, value, meaning in merged)
    return "\n".join(lines).replace("| --- | --- | --- |", "|---|---|---|") + "\n"


def _rows(struct: type[msgspec.Struct], prefix: str = "") -> list[tuple[str, str, str]]:
    rows: list[tuple[str, str, str]] = []
    meanings = meanings_of(struct)
    has_content = issubclass(struct, contents.Contents) and struct is not contents.Contents
    for field in types.type_info(struct).fields:  # type: ignore[attr-defined]
        if has_content and field.encode_name in contents.CONTENTS:
            continue  # they have a table of their own
        form, meaning = _without_nil(field.type), meanings.get(field.encode_name, "")
        more = _default(field) if issubclass(struct, Contract) else "" if form is field.type else " or nil"
        rows.append((f"`{prefix}{field.encode_name}`", _value(form) + more, meaning))
        if isinstance(form, types.StructType) and prefix == "" and struct in (contents.Contents, effects.Effect):
            rows += _rows(form.cls, f"{field.encode_name}.")
    return rows


def _without_nil(form: types.Type) -> types.Type:
    if not isinstance(form, types.UnionType):
        return form
    left = tuple(one for one in form.types if not isinstance(one, types.NoneType))
    return left[0] if len(left) == 1 else types.UnionType(left)


def _default(field: types.Field) -> str:
    default = field.default
    if field.required:
        return ""
    if isinstance(default, bool):
        return f", default {str(default).lower()}"
    if isinstance(default, str) and default:
        return f", default `{default}`"
    if isinstance(default, int | float):
        return f", default {default:g}"
    if isinstance(default, tuple) and default:
        return f", default {json.dumps(default)}"
    return ", optional"


def _value(form: types.Type) -> str:
    match form:
        case types.FloatType(ge=low, le=high):
            return "number" if low is None else f"{low:.6g} .. {high:.6g}"
        case types.IntType(ge=low, le=high):
            return "whole" if low is None else f"{low} .. {high}, whole"
        case types.StrType(min_length=low, max_length=high):
            return "text" if high is None else "name" if high == 32 else f"{low} .. {high} printable characters"
        case types.BytesType(min_length=low, max_length=high):
            return "bytes" if high is None else f"{high} bytes" if low == high else f"{low} .. {high} bytes"
        case types.BoolType():
            return "boolean"
        case types.LiteralType(values=values):
            return " or ".join(f"`{value}`" if isinstance(value, str) else str(value) for value in values)
        case types.TupleType(item_types=items):
            values = [f"{one}s" if one == "number" else one for one in dict.fromkeys(map(_value, items))]
            return f"pair of {' and '.join(values)}"
        case types.VarTupleType(item_type=item, min_length=low, max_length=high):
            count = "" if high is None else f"at most {high} " if low is None else f"{low} .. {high} "
            first, *more = _value(item).split(" ", 1)
            return " ".join([f"{count}{first}s", *more])
        case types.UnionType(types=options):
            return (
                "map"
                if all(isinstance(one, types.StructType) for one in options)
                else " or ".join(map(_value, options))
            )
        case types.StructType():
            return "map"
    return "map"


# --- meanings ---------------------------------------------------------------------------------------------------


@cache
def meanings_of(struct: type) -> dict[str, str]:
    """Return the docstring behind each field, of its bases too, by the name that messages have."""
    names = dict(zip(struct.__struct_fields__, struct.__struct_encode_fields__, strict=True))
    found: dict[str, str] = {}
    for base in reversed(struct.__mro__):
        if base.__module__.startswith("hapticd_contract"):
            found |= _docstrings(base)
    return {names[name]: text for name, text in found.items() if name in names}


def _docstrings(kind: type) -> dict[str, str]:
    body = ast.parse(inspect.getsource(kind)).body[0].body  # type: ignore[attr-defined]
    found: dict[str, str] = {}
    for before, node in pairwise(body):
        if isinstance(before, ast.AnnAssign) and isinstance(before.target, ast.Name) and isinstance(node, ast.Expr):
            found[before.target.id] = " ".join(ast.literal_eval(node.value).split())
    return found


def _struct(name: str) -> type[msgspec.Struct]:
    kind: type[msgspec.Struct] = next(found for module in MODULES if (found := getattr(module, name, None)) is not None)
    return kind


if __name__ == "__main__":
    main()
