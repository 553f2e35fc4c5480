# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The stubs say what the compiled module has: names, arguments, which of them by name alone."""

import ast
import inspect
import re
from pathlib import Path

import soilvdb
from soilvdb import _soilvdb

STUB = ast.parse((Path(soilvdb.__file__).parent / "_soilvdb.pyi").read_text())


def stub_arguments(function):
    names = [a.arg for a in function.args.args if a.arg != "self"]
    return names, [a.arg for a in function.args.kwonlyargs]


def real_arguments(function):
    signature = function.__doc__.splitlines()[0]
    inside = signature[signature.index("(") + 1:signature.rindex(")")]
    while re.search(r"[\[(][^\[\]()]*[\])]", inside):  # types and defaults of several parts
        inside = re.sub(r"[\[(][^\[\]()]*[\])]", "", inside)
    names = [part.split(":")[0].split("=")[0].strip() for part in inside.split(",")]
    names = [name for name in names if name not in ("self", "")]
    if "*" not in names:
        return names, []
    at = names.index("*")
    return names[:at], names[at + 1:]


def public(names):
    return {n for n in names if not n.startswith("_") or n in ("__init__", "__enter__")}


def test_all_names_are_in_both():
    stubs = public({n.name for n in STUB.body if isinstance(n, (ast.ClassDef, ast.FunctionDef))})
    assert stubs == public(vars(_soilvdb))
    assert stubs <= set(soilvdb.__all__)


def test_classes_have_the_same_members_and_arguments():
    checked = 0
    for node in STUB.body:
        if not isinstance(node, ast.ClassDef):
            continue
        real = getattr(_soilvdb, node.name)
        functions = {f.name: f for f in node.body if isinstance(f, ast.FunctionDef)}
        attributes = {a.target.id for a in node.body if isinstance(a, ast.AnnAssign)}
        # Those without a constructor come from functions.
        assert public({*functions, *attributes}) == public(vars(real)) - (
            {"__init__"} if node.name in ("CutGeometry", "Heap", "Patch", "Resistance", "Survey",
                                          "SurveyedGround", "Terrain", "Update", "Volume") else set()), node.name
        assert all(isinstance(vars(real)[name], property) for name in attributes)
        for name, function in functions.items():
            if name.startswith("_") and name not in public([name]):
                continue
            member = vars(real)[name]
            if isinstance(member, property) or name == "__exit__":
                continue
            member = getattr(real, name)
            assert stub_arguments(function) == real_arguments(member), f"{node.name}.{name}"
            assert name.startswith("__") or member.__doc__.strip().count("\n") > 1, "undocumented"
            checked += 1
    for node in STUB.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            assert stub_arguments(node) == real_arguments(getattr(_soilvdb, node.name)), node.name
            checked += 1
    assert checked > 25


def test_a_vector_site_takes_what_the_calls_of_many_sites_take():
    """By name, with types: an editor knows them, and mypy refuses others."""
    stubs = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}
    for method, function, own in (("height_map", "height_maps", {"sites", "threads"}),
                                  ("step", "update_many", {"sites", "time"})):
        parameters = inspect.signature(getattr(soilvdb.VectorSite, method)).parameters
        assert {p.kind for p in parameters.values()} <= {
            inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY}
        assert all(p.annotation not in ("Any", inspect.Parameter.empty)
                   for name, p in parameters.items() if name != "self")
        assert set(parameters) - {"self"} == set(sum(stub_arguments(stubs[function]), [])) - own
