# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Explains wrong arguments of a call in one line, from pybind11's text and the arguments."""

import os
import re
from typing import Any

import soilvdb


def _split(text: str) -> list[str]:
    """The parts between commas that are not in brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += letter in "[(" and 1 or letter in "])" and -1
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts if part.strip()]


def _kinds(of: str) -> list[str]:
    """Python's names of the types that an argument may have."""
    union = re.fullmatch(r"(Optional|Union)\[(.*)\]", of)
    if not union:
        return [{"os.PathLike": "path"}.get(of, of.split(".")[-1])]
    kinds = [kind for part in _split(union[2]) for kind in _kinds(part)]
    return kinds + ["None"] * (union[1] == "Optional")


def _fits(value: Any, kind: str) -> bool:
    if kind == "None":
        return value is None
    if kind == "float":
        return hasattr(value, "__float__") or hasattr(value, "__index__")
    if kind == "int":
        return hasattr(value, "__index__")
    if kind == "path":
        return isinstance(value, (str, bytes, os.PathLike))
    known = {"str": str, "bytes": bytes, "bool": bool}.get(kind, getattr(soilvdb, kind, object))
    return isinstance(value, known) if isinstance(known, type) else True


def explain(text: str, given: tuple[Any, ...], named: dict[str, Any]) -> str:
    """One line for pybind11's text about wrong arguments."""
    signature = re.search(r"^ +1\. ([\w.]*)\((.*)\)(?: -> .*)?$", text, flags=re.M)
    if not signature:
        return text.splitlines()[0]
    function = text.split("(", 1)[0]
    if function == "__init__":
        function, given = signature[1].split(".")[-1], given[1:]
    parts = _split(signature[2])
    by_place = parts.index("*") if "*" in parts else len(parts)
    takes = {}
    for part in parts:
        name, _, of = part.partition(": ")
        if of:
            takes[name] = (_kinds(of.split(" = ")[0]), " = " in of)
    names = list(takes)
    shown = ", ".join(name for name in names if name != "self")
    for name in named:
        if name not in takes:
            return f"{function}() has no argument '{name}'; it has {shown}"
    if len(given) > by_place:
        if by_place < len(names):
            return f"{function}() takes '{names[by_place]}' by name"
        return f"{function}() takes no more arguments than ({shown})"
    values = dict(zip(names, given))
    for name in named:
        if name in values:
            return f"{function}() is given '{name}' twice"
    values.update(named)
    for name, (kinds, has_default) in takes.items():
        if name not in values:
            if not has_default:
                return f"{function}() misses '{name}'; it takes ({shown})"
        elif not any(_fits(values[name], kind) for kind in kinds):
            return f"{name} must be {' or '.join(kinds)}, not {type(values[name]).__name__}"
    return f"{function}() can't count so far: a whole number of ({shown}) is out of range"
