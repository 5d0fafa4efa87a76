"""Checks of what a program gives, by the daemon's own contract: all targets of a client share one message, and one
invalid value would make the daemon refuse the whole message."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, SupportsFloat, SupportsIndex, TypeVar

import msgspec

from hapticd_contract.base import Contract, FingerId, Name, problem_of_name
from hapticd_contract.sentences import ContractError, converted
from hapticd_contract.states import FingerState

from .errors import RefusedError

Made = TypeVar("Made", bound=Contract)


def checked(value: Made) -> Made:
    """Return a value of the contract with its parts as the contract has them: numbers of NumPy as Python's, lists as
    tuples. Raises RefusedError."""
    made: Made = plain("", value, type(value))
    return made


def plain(where: str, value: object, kind: Any) -> Any:
    """Return a value as `kind`, a type of the contract; `where` is its name in errors. Raises RefusedError."""
    try:
        return converted(msgspec.to_builtins(value, builtin_types=(bytes,), enc_hook=_as_python), kind, where)
    except ContractError as error:
        raise RefusedError(str(error)) from None
    except (OverflowError, RecursionError):
        raise RefusedError(f"{where or 'value'}: is more than a message can have: {shown(value)}.") from None


def label(where: str, value: object) -> str:
    """Return a name of 1 .. 32 printable characters. Raises RefusedError."""
    name: str = plain(where, value, Name)
    if problem := problem_of_name(name, where):
        raise RefusedError(problem)
    return name


def finger_key(where: str, finger: object) -> int | str:
    """Return the id of a finger, or a virtual finger's name. Raises RefusedError."""
    key = finger.id if isinstance(finger, FingerState) else finger
    if isinstance(key, str):
        return label(where, key)
    if isinstance(key, bool) or not isinstance(key, SupportsIndex):
        raise RefusedError(f"{where}: must be one of fingers(), its id or a name, not {shown(key)}.")
    finger_id: int = plain(where, key, FingerId)
    return finger_id


def shown(value: object) -> str:
    """Return what a program gave, for an error."""
    return repr(value)[:40]


def _as_python(value: object) -> object:
    """Return NumPy's numbers and arrays, and what else is no plain value, as Python's."""
    if isinstance(value, Iterable):
        return list(value)
    if isinstance(value, SupportsIndex):
        return value.__index__()
    if isinstance(value, SupportsFloat):
        return float(value)
    raise RefusedError(f"{shown(value)}: is nothing that a message can have.")
