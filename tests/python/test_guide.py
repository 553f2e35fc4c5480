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
        assert match.group(1) in ("python", "sh", "yaml", "csv", "xml"), f"{page}:{line}"
        found.append((line, match.group(1), match.group(2)))
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


def test_the_reference_is_that_of_the_docstrings():
    made = subprocess.run([sys.executable, ROOT / "tools/guide/make_reference.py"], text=True,
                          capture_output=True, check=True).stdout
    wanted = (ROOT / "tools/guide/python_reference.md").read_text()
    assert made == wanted, "make it anew: the head of make_reference.py says how"
