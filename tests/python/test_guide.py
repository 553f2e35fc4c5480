# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Every block of code in the guide runs, in the order in which it stands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import soilvdb

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "tools/guide").glob("*.md"))
BUILD = Path(soilvdb.__file__).absolute().parents[2]

RUNNER = """
import json, subprocess, sys
shared = {"__name__": "__main__"}
for line, language, code in json.load(sys.stdin):
    print(f"{sys.argv[1]}:{line}", file=sys.stderr)
    if language == "python":
        exec(compile(code, f"{sys.argv[1]}:{line}", "exec"), shared)
    elif language == "sh":
        subprocess.run(["bash", "-euo", "pipefail", "-c", code], check=True)
    else:
        first, rest = code.split("\\n", 1)
        name = first.split("file:")[1].split("-->")[0].strip()
        open(name, "w").write(rest)
"""


def blocks(page):
    text = page.read_text()
    found = []
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, flags=re.S | re.M):
        line = text.count("\n", 0, match.start()) + 1
        language, code = match.group(1), match.group(2)
        if language == "cpp" or page.stem == "scenario":
            continue  # tools/test_package builds the one, scenario_test reads the other
        assert language in ("python", "sh", "yaml", "csv", "xml"), f"{page}:{line}"
        found.append((line, language, code))
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_its_blocks_run(page, tmp_path):
    import json

    environment = dict(os.environ, PATH=f"{BUILD}:{os.environ['PATH']}",
                       PYTHONPATH=str(BUILD / "python"))
    done = subprocess.run([sys.executable, "-c", RUNNER, page.name], cwd=tmp_path, text=True,
                          input=json.dumps(blocks(page)), env=environment, capture_output=True,
                          check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", PAGES + [ROOT / "README.md"], ids=lambda page: page.stem)
def test_its_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target


def test_pages_are_all_in_the_index():
    index = (ROOT / "tools/guide/README.md").read_text()
    for page in PAGES:
        assert page.name == "README.md" or f"({page.name})" in index


def test_all_that_a_run_says_is_in_the_reference(tmp_path):
    (tmp_path / "s.yaml").write_text("""
soilvdb: 1
voxel_size: 0.1
terrain: {plane: {z: 0.0}}
soil: {repose_angle: 0.61}
machines:
  - {name: digger, bucket: {width: 1, height: 1, profile: [[0, 0], [-1, 0.5], [0, 1]]}, motion: m.csv}
""")
    (tmp_path / "m.csv").write_text("time,x,y,z\n0,0,0,-0.1\n1,1,0,-0.1\n")
    summary = soilvdb.run(tmp_path / "s.yaml", out=tmp_path / "out")
    reference = (ROOT / "tools/guide/outputs.md").read_text()

    def names(value):
        if isinstance(value, dict):
            return set(value).union(*map(names, value.values()))
        return set().union(*map(names, value)) if isinstance(value, list) else set()

    columns = (tmp_path / "out/updates.csv").read_text().splitlines()[0].split(",")
    missing = [name for name in sorted(names(summary)) + columns if f"`{name}`" not in reference]
    assert not missing


def test_the_reference_is_that_of_the_docstrings():
    made = subprocess.run([sys.executable, ROOT / "tools/guide/make_reference.py"], text=True,
                          capture_output=True, check=True).stdout
    wanted = (ROOT / "tools/guide/python_reference.md").read_text()
    assert made == wanted, "make it anew: the head of make_reference.py says how"
