"""Writes the messages' types into `clients/javascript/hapticd.d.ts`, between its two marks.

`python clients/schema/write.py` does it too; a test compares them. They follow from `hapticd_contract`, as the
JSON schemas do.
"""

from __future__ import annotations

import json
import re
import runpy
from pathlib import Path
from typing import Any

from msgspec import inspect as types

WRITE = runpy.run_path(str(Path(__file__).with_name("write.py")))
TARGET = Path(__file__).parents[1] / "javascript" / "hapticd.d.ts"
MADE = re.compile(r"(// --- made of the contract [^\n]*\n)(.*?)(// --- end\n)", re.DOTALL)
PLAIN = {
    types.FloatType: "number",
    types.IntType: "number",
    types.StrType: "string",
    types.BytesType: "Bytes",
    types.BoolType: "boolean",
    types.NoneType: "null",
}


def main() -> None:
    """Write the types."""
    TARGET.write_text(with_types(TARGET.read_text(encoding="utf-8")), encoding="utf-8")


def with_types(text: str) -> str:
    """Return the file with the contract's types as they are now."""
    return MADE.sub(lambda found: found[1] + declarations() + found[3], text)


def declarations() -> str:
    """Return an interface for each type of the contract that messages hold."""
    found: dict[str, types.StructType] = {}
    for kind in WRITE["SCHEMAS"].values():
        _collect(types.type_info(kind), found)
    return "".join(_interface(info) + "\n" for info in found.values())


def _collect(form: Any, found: dict[str, types.StructType]) -> None:
    if isinstance(form, types.StructType):
        if form.cls.__name__ in found:
            return
        found[form.cls.__name__] = form
        for field in form.fields:
            _collect(field.type, found)
    for name in ("types", "item_types"):
        for one in getattr(form, name, ()):
            _collect(one, found)
    if getattr(form, "item_type", None) is not None:
        _collect(form.item_type, found)


def _interface(info: types.StructType) -> str:
    lines = [f"/** {_sentence(info.cls.__doc__ or '')} */", f"export interface {_name(info)} {{"]
    if info.tag_field is not None:
        lines.append(f"  {info.tag_field}: {json.dumps(info.tag)};")
    meanings = WRITE["meanings_of"](info.cls)
    for field in info.fields:
        if meanings.get(field.encode_name):
            lines.append(f"  /** {meanings[field.encode_name]} */")
        is_sent = issubclass(info.cls, WRITE["Contract"]) or info.cls.__struct_config__.omit_defaults
        mark = "" if field.required or not is_sent else "?"
        lines.append(f"  {field.encode_name}{mark}: {_type(field.type)};")
    return "\n".join([*lines, "}", ""])


def _name(info: types.StructType) -> str:
    """Return a type's name; the class of the module is `Plate`, so the reply is its description."""
    name: str = info.cls.__name__
    return "PlateDescription" if name == "Plate" else name


def _sentence(text: str) -> str:
    return " ".join(text.split()).replace("*/", "* /")


def _type(form: Any) -> str:
    if type(form) in PLAIN:
        return PLAIN[type(form)]
    match form:
        case types.StructType():
            return _name(form)
        case types.LiteralType(values=values):
            return " | ".join(map(json.dumps, values))
        case types.UnionType(types=options):
            return " | ".join(map(_type, options))
        case types.TupleType(item_types=items):
            return f"readonly [{', '.join(map(_type, items))}]"
        case types.VarTupleType(item_type=item) | types.ListType(item_type=item):
            inner = _type(item)
            return f"readonly ({inner})[]" if "|" in inner else f"readonly {inner}[]"
        case types.DictType(value_type=value):
            return f"Record<string, {_type(value)}>"
    return "unknown"


if __name__ == "__main__":
    main()
