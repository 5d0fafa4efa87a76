"""Sentences for what msgspec refuses: the place, what is wrong, and the bounds.

Only what was refused is looked at here, by the contract's types. A received value is never printed whole: a hostile one
may be deep, long or unprintable.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import msgspec

from .base import Contract

if TYPE_CHECKING:
    from msgspec import inspect

MAX_SHOWN_BITS: Final = 64
MAX_SHOWN_CHARACTERS: Final = 32
BYTES: Final = "bytes (base64 in JSON)"
_KINDS: Final[dict[type, str]] = {
    dict: "a map",
    list: "a list",
    tuple: "a list",
    str: "a text",
    bytes: "bytes",
    bool: "a truth value",
    int: "a whole number",
    type(None): "nil",
}


class ContractError(ValueError):
    """A message is not as the contract has it; the text is one sentence for its sender."""


def converted(value: object, kind: Any, where: str = "") -> Any:
    """Return plain values (maps, lists, texts, numbers, bytes) as `kind`, a type of the contract. `where` is their
    place in errors. Raises ContractError."""
    try:
        made = msgspec.convert(value, kind, builtin_types=(bytes,))
    except (msgspec.ValidationError, RecursionError):
        raise ContractError(explained(value, kind, where)) from None
    check(made, where)
    return made


def check(made: object, where: str = "") -> None:
    """Raise ContractError for what is wrong between fields."""
    if isinstance(made, Contract) and (problem := made.problem()):
        raise ContractError(_sentence(where + problem))


def explained(value: object, kind: Any, where: str = "") -> str:
    """Return what is wrong with a value that msgspec refuses as `kind`."""
    found = next(_defects(value, _info(kind), where), ": is not as clients/PROTOCOL.md has it.")
    return _sentence(found)


def _sentence(found: str) -> str:
    place, _, what = found.removeprefix(".").partition(": ")
    return f"{place}: {what}" if place else f"The message {what}" if what.startswith("must be") else what


@lru_cache(maxsize=64)
def _info(kind: Any) -> inspect.Type:
    from msgspec import inspect  # takes a millisecond, and mostly nothing is refused

    return inspect.type_info(kind)


def _defects(value: Any, form: Any, place: str) -> Iterator[str]:
    """Yield the defects of a value, each with its place; the form is one of `msgspec.inspect`."""
    shape = type(form).__name__
    if shape == "AnyType":
        return
    if shape == "UnionType":
        yield from _defects_of_union(value, form, place)
    elif shape == "StructType":
        yield from _defects_of_map(value, form, place)
    elif shape == "DictType":
        if not isinstance(value, dict):
            yield f"{place}: must be a map, not {_kind(value)}."
            return
        if form.max_length is not None and len(value) > form.max_length:
            yield f"{place}: has {len(value)} entries, at most {form.max_length} are allowed."
        for name, one in value.items():
            yield from _defects(name, form.key_type, place)
            yield from _defects(one, form.value_type, f"{place}.{_shown_name(name)}")
    elif shape in ("VarTupleType", "TupleType", "ListType"):
        yield from _defects_of_list(value, form, place)
    elif shape == "LiteralType":
        if value not in form.values or isinstance(value, bool):
            yield f"{place}: must be {_named(form)}."
    elif not _is_of_kind(value, shape):
        yield f"{place}: must be {_named(form)}, not {_kind(value)}."
    elif shape in ("FloatType", "IntType"):
        yield from _defects_of_number(value, form, place)
    elif shape in ("StrType", "BytesType"):
        least, most = form.min_length or 0, form.max_length
        if not least <= len(value) or (most is not None and len(value) > most):
            span = f"{most}" if least == most else f"{least} .. {most}"
            has = "" if shape == "StrType" else f"has {len(value)} bytes, it "
            yield f"{place}: {has}must have {span}{' printable characters' if shape == 'StrType' else ''}."


def _defects_of_union(value: Any, form: Any, place: str) -> Iterator[str]:
    options = [one for one in form.types if type(one).__name__ != "NoneType"]
    if value is None and len(options) < len(form.types):
        return
    tag_field = getattr(options[0], "tag_field", None)
    if tag_field is not None and isinstance(value, dict):
        options_by_tag = {one.tag: one for one in options}
        tag = value.get(tag_field)
        if tag_field not in value:
            yield f"{place}.{tag_field}: is missing."
        elif not isinstance(tag, str) or tag not in options_by_tag:
            yield f"{place}.{tag_field}: must be one of {', '.join(options_by_tag)}."
        else:
            yield from _defects(value, options_by_tag[tag], place)
        return
    fitting = [one for one in options if _is_of_kind(value, type(one).__name__)]
    if fitting:
        yield from _defects(value, fitting[0], place)
    else:
        names = dict.fromkeys([_named(one) for one in options])
        yield f"{place}: must be {' or '.join(names)}, not {_kind(value)}."


def _defects_of_map(value: Any, form: Any, place: str) -> Iterator[str]:
    if not isinstance(value, dict):
        yield f"{place}: must be a map, not {_kind(value)}."
        return
    fields = {field.encode_name: field for field in form.fields}
    for name in value:
        if name not in fields and name != form.tag_field and form.forbid_unknown_fields:
            yield f"{place}.{_shown_name(name)}: unknown field, see clients/PROTOCOL.md."
    for name, field in fields.items():
        if name in value:
            yield from _defects(value[name], field.type, f"{place}.{name}")
        elif field.required:
            yield f"{place}.{name}: is missing."


def _defects_of_list(value: Any, form: Any, place: str) -> Iterator[str]:
    if not isinstance(value, list | tuple):
        yield f"{place}: must be a list, not {_kind(value)}."
        return
    forms = getattr(form, "item_types", None)
    if forms is not None and len(value) != len(forms):
        yield f"{place}: has {len(value)} items, it must have {len(forms)}."
        return
    least, most = getattr(form, "min_length", None) or 0, getattr(form, "max_length", None)
    if most is not None and len(value) > most:
        yield f"{place}: has {len(value)} items, at most {most} are allowed."
    elif len(value) < least:
        yield f"{place}: has {len(value)} items, it must have at least {least}."
    for index, one in enumerate(value):
        yield from _defects(one, form.item_type if forms is None else forms[index], f"{place}[{index}]")


def _defects_of_number(value: Any, form: Any, place: str) -> Iterator[str]:
    low, high = form.ge, form.le
    if (low is not None and not value >= low) or (high is not None and not value <= high):
        bounds = f"{low} .. {high}" if isinstance(value, int) and isinstance(high, int) else f"{low:g} .. {high:g}"
        yield f"{place}: {_shown(value)} is out of bounds, it must be {bounds}."


def _is_of_kind(value: object, shape: str) -> bool:
    kinds: dict[str, tuple[type, ...]] = {
        "FloatType": (float, int),
        "IntType": (int,),
        "StrType": (str,),
        "BytesType": (bytes,),
        "BoolType": (bool,),
        "StructType": (dict,),
        "DictType": (dict,),
        "VarTupleType": (list, tuple),
        "TupleType": (list, tuple),
    }
    return type(value) in kinds.get(shape, ())


def _named(form: Any) -> str:
    shape = type(form).__name__
    if shape == "LiteralType":
        return f"one of {', '.join(map(str, form.values))}" if len(form.values) > 1 else str(form.values[0])
    return {"FloatType": "a number", "IntType": "a whole number", "StrType": "a text", "BytesType": BYTES}.get(
        shape, {"BoolType": "true or false", "StructType": "a map", "DictType": "a map"}.get(shape, "a list")
    )


def _kind(value: object) -> str:
    return repr(value) if isinstance(value, float) else _KINDS.get(type(value), "a MessagePack extension")


def _shown(value: float) -> str:
    """Return a received number: JSON has whole numbers that neither a float nor a line holds."""
    if isinstance(value, int):
        return str(value) if value.bit_length() <= MAX_SHOWN_BITS else f"a whole number of {value.bit_length()} bits"
    return f"{value:g}"


def _shown_name(name: object) -> str:
    shown = str(name)[:MAX_SHOWN_CHARACTERS]
    return shown if shown.isprintable() else ascii(shown)[1:-1]
