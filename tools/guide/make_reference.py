# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Makes python_reference.md from the docstrings and stubs of the module; a test compares them.

    PYTHONPATH=build/python python3 tools/guide/make_reference.py > tools/guide/python_reference.md
"""

import ast
import inspect
import textwrap
from pathlib import Path

import soilvdb


def text_of(thing):
    """A docstring without the signature that pybind11 puts before it, and without examples."""
    paragraphs = (inspect.getdoc(thing) or "").split("\n\n")
    lines = "\n".join(p for p in paragraphs if not p.startswith("    ")).splitlines()
    if lines and "->" in lines[0] and "(" in lines[0]:
        lines = lines[1:]
    return textwrap.fill(" ".join(" ".join(lines).split()), 100)


def signature(name, function):
    """As the stub has it, without types."""
    arguments = function.args
    named = [a.arg for a in arguments.args if a.arg != "self"]
    first_default = len(named) - len(arguments.defaults)
    parts = [n if i < first_default else f"{n}=..." for i, n in enumerate(named)]
    if arguments.kwonlyargs:
        parts.append("*")
        parts += [a.arg if d is None else f"{a.arg}=..."
                  for a, d in zip(arguments.kwonlyargs, arguments.kw_defaults)]
    return f"{name}({', '.join(parts)})"


def attribute(node):
    """The name of an attribute or property; None for a method."""
    if isinstance(node, ast.AnnAssign):
        return node.target.id
    decorators = getattr(node, "decorator_list", ())
    return node.name if any(getattr(d, "id", "") == "property" for d in decorators) else None


def members(node, thing):
    functions = [n for n in node.body if isinstance(n, ast.FunctionDef)]
    properties = [name for name in map(attribute, node.body) if name and not name.startswith("_")]
    for name in properties:
        text = text_of(getattr(thing, name))
        yield f"- `{name}`" + (f": {text[0].lower() + text[1:]}" if text else "")
    if properties:
        yield ""
    shown = set()  # of overloads the first
    for function in functions:
        if function.name.startswith("_") or function.name in properties:
            continue
        if function.name not in shown:
            shown.add(function.name)
            yield section(signature(function.name, function), getattr(thing, function.name))


def section(heading, thing):
    return f"### `{heading}`\n\n{text_of(thing)}\n"


def arguments_of(function):
    """Of one that is written in Python, without types."""
    parts, named = [], False
    for p in inspect.signature(function).parameters.values():
        if p.kind is p.KEYWORD_ONLY and not named:
            parts.append("*")
            named = True
        if p.name != "self":
            parts.append(p.name + ("" if p.default is p.empty else "=..."))
    return ", ".join(parts)


def main():
    stub = ast.parse((Path(soilvdb.__file__).parent / "_soilvdb.pyi").read_text())
    print("# Reference of the Python module\n")
    print("`make_reference.py` makes this page from the docstrings; `help(soilvdb.Site)` shows them "
          "too.\n")
    last = (soilvdb.__doc__ or "").strip().split("\n\n")[-1]
    print(textwrap.fill(" ".join(last.split()), 100) + "\n")
    for node in stub.body:
        if isinstance(node, ast.ClassDef):
            thing = getattr(soilvdb, node.name)
            print(f"## {node.name}\n")
            init = [n for n in node.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"]
            print(text_of(thing) + "\n")
            if init:
                print(section(signature(node.name, init[0]), thing.__init__))
            for member in members(node, thing):
                print(member)
    for thing, names in (
            (soilvdb.VectorSite, ("__init__", "step", "height_map", "resistance", "loads", "reset",
                                  "randomise")),
            (soilvdb.Steps, ()),
            (soilvdb.Ensemble, ("__init__", "update", "load", "cut", "resistance")),
            (soilvdb.Spread, ()), (soilvdb.WrenchSpread, ()), (soilvdb.Wrench, ()),
            (soilvdb.Identified, ()), (soilvdb.StateError, ()), (soilvdb.NoGroundError, ())):
        print(f"## {thing.__name__}\n\n{text_of(thing)}\n")
        for name in names:
            function = getattr(thing, name)
            heading = f"{thing.__name__ if name == '__init__' else name}({arguments_of(function)})"
            print(section(heading, function))
    print("## Functions\n")
    for node in stub.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            print(section(signature(node.name, node), getattr(soilvdb, node.name)))
    written = (soilvdb.identify, soilvdb.depth_image, soilvdb.lidar_turn, soilvdb.run)
    print("\n".join(section(f"{f.__name__}({arguments_of(f)})", f) for f in written).strip())


if __name__ == "__main__":
    main()
