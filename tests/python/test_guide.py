# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Every block of code in the guide and in README runs, in the order in which it stands."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import soilvdb

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
PAGES = sorted((ROOT / "tools/guide").glob("*.md"))
BUILD = Path(soilvdb.__file__).absolute().parents[2]
LANGUAGES = ("python", "sh", "yaml", "csv", "xml", "cpp", "cmake")
OF_PROXIES = ("nginx", "caddy")  # tests/serve runs the first

RUNNER = """
import json, subprocess, sys
shared = {"__name__": "__main__"}
for line, language, code in json.load(sys.stdin):
    print(f"{sys.argv[1]}:{line}", file=sys.stderr, flush=True)
    if language == "python":
        exec(compile(code, f"{sys.argv[1]}:{line}", "exec"), shared)
        sys.stdout.flush()
    elif language == "sh":
        subprocess.run(["bash", "-euo", "pipefail", "-c", code], check=True)
    else:
        first, rest = code.split("\\n", 1)
        name = first.split("file:")[1].split("-->")[0].strip()
        open(name, "w").write(rest)
"""

# What README leaves to the reader, around its C++.
PROJECT = """# file: CMakeLists.txt
cmake_minimum_required(VERSION 3.22)
project(my_program LANGUAGES CXX)
add_executable(my_program main.cc)
"""
BUILD_PROJECT = "cmake -S . -B built && cmake --build built && built/my_program\n"


def blocks(page):
    text = page.read_text()
    found = []
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, flags=re.S | re.M):
        line, language, code = text.count("\n", 0, match.start()) + 1, match.group(1), match.group(2)
        if language in OF_PROXIES:
            continue
        assert language in LANGUAGES, f"{page}:{line}"
        if language == "csv":  # has no comments; its name is the line before it
            name = re.search(r"^`([^`\n]+)`:\n\n\Z", text[:match.start()], flags=re.M)
            assert name, f"{page}:{line}: has no name"
            code = f"# file: {name.group(1)}\n{code}"
        if page == README and language == "cpp":
            code = "// file: main.cc\n" + code
        if page == README and language == "cmake":
            code = PROJECT + code
        found.append((line, language, code))
    if page == README:
        found.append((0, "sh", BUILD_PROJECT))
    return found


@pytest.fixture(scope="module")
def prefix(tmp_path_factory):
    """Where the libraries are installed, for blocks in C++."""
    to = tmp_path_factory.mktemp("prefix")
    subprocess.run(["cmake", "--install", BUILD, "--prefix", to], check=True, capture_output=True)
    return to


def run_blocks(page, folder, **environment):
    python = Path(sys.executable).parent  # python3 is this one
    environment = dict(os.environ, PATH=f"{BUILD}:{python}:{os.environ['PATH']}",
                       PYTHONPATH=str(BUILD / "python"), **environment)
    done = subprocess.run([sys.executable, "-c", RUNNER, page.name], cwd=folder, text=True,
                          input=json.dumps(blocks(page)), env=environment, capture_output=True,
                          check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


# The others' blocks run in tests of their own, here, in test_outputs.py and in scenario_test.cc.
ALONE = [page for page in PAGES if page.stem not in ("cpp", "outputs", "scenario")]


@pytest.mark.parametrize("page", ALONE, ids=lambda page: page.stem)
def test_its_blocks_run(page, tmp_path):
    run_blocks(page, tmp_path)


def test_its_programs_in_cpp_run(prefix, tmp_path):
    out = run_blocks(ROOT / "tools/guide/cpp.md", tmp_path, CMAKE_PREFIX_PATH=str(prefix))
    load = float(re.search(r"^load ([0-9.]+) m3 after", out, flags=re.M).group(1))
    assert 0.1 <= load < 0.12, "stops at the load that it was given"
    assert "load 0.480 m3, ground at -0.20 m" in out, "1.2 m x 0.2 m x 2 m"
    assert re.search(r"^[1-9][0-9]* blocks meshed beside updates$", out, flags=re.M)


def test_readme_runs(prefix, tmp_path):
    (tmp_path / "build").symlink_to(BUILD)
    out = run_blocks(README, tmp_path, CMAKE_PREFIX_PATH=str(prefix))
    in_python, in_cpp = re.findall(r"^([0-9.]+) m3 in the bucket", out, flags=re.M)
    printed, = re.findall("^# ([0-9.]+ m3 in the bucket, .*)$", README.read_text(), flags=re.M)
    assert printed in out and "[-0.25 " in printed, "0.25 m deep, as far as the lip goes"
    assert in_cpp == "0.48", "1.2 m x 0.2 m x 2 m"
    for made in ("dug.vdb", "out/trench/summary.json", "out/trench/view.png"):
        assert (tmp_path / made).stat().st_size > 1000


@pytest.mark.parametrize("page", PAGES + [README], ids=lambda page: page.stem)
def test_its_links_lead_somewhere(page):
    for target, place in re.findall(r"\]\(([^)#:]*)(?:#([^)]*))?\)", page.read_text()):
        to = page.parent / target if target else page
        assert to.exists(), target
        if place:
            heads = re.findall(r"^#+ (.*)$", to.read_text(), flags=re.M)
            assert place in [re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in heads], place


def test_pages_are_all_in_the_index():
    index = (ROOT / "tools/guide/README.md").read_text()
    for page in PAGES:
        assert page.name == "README.md" or f"({page.name})" in index


def test_the_reference_is_that_of_the_docstrings():
    made = subprocess.run([sys.executable, ROOT / "tools/guide/make_reference.py"], text=True,
                          capture_output=True, check=True).stdout
    wanted = (ROOT / "tools/guide/python_reference.md").read_text()
    assert made == wanted, "make it anew: the head of make_reference.py says how"


def test_the_picture_of_the_force_can_be_drawn_anew():
    """Wedge, axes and words are those of the guide's; the digs are this version's, from left to right."""
    made = subprocess.run([sys.executable, ROOT / "tools/guide/force_picture.py"], text=True,
                          capture_output=True, check=True).stdout
    digs = []

    def without_digs(svg):
        return re.sub(r'points="[^"]{5000,}"', lambda curve: digs.append(curve[0]), svg)

    assert without_digs(made) == without_digs((ROOT / "tools/guide/force.svg").read_text())
    assert len(digs) == 2 * 4 and made.startswith("<svg")
    ends = [[float(pair.split(",")[0]) for pair in (curve.split('"')[1].split()[i] for i in (0, -1))] for curve in digs]
    assert ends[:4] == ends[4:], "all go the whole way"
