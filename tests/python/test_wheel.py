# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What pip makes a wheel of is this module, in this version. Building it takes minutes: not here."""

import shutil
import subprocess
import sys
import tomllib
from email.parser import Parser
from pathlib import Path

import soilvdb

PYTHON = Path(__file__).parents[2] / "tools/python"


def test_pip_is_told_name_version_and_files(tmp_path):
    shutil.copy(PYTHON.parents[1] / "CMakeLists.txt", tmp_path)
    copy = tmp_path / "tools/python"
    shutil.copytree(PYTHON, copy, ignore=shutil.ignore_patterns("build", "dist", "*.egg-info"))
    subprocess.run([sys.executable, "setup.py", "-q", "egg_info"], cwd=copy, check=True)
    told = Parser().parsestr((copy / "soilvdb.egg-info/PKG-INFO").read_text())
    assert told["Name"] == "soilvdb"
    assert told["Version"] == soilvdb.__version__
    data = tomllib.loads((PYTHON / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    packaged = {file.name for pattern in data["soilvdb"] for file in (PYTHON / "soilvdb").glob(pattern)}
    packaged |= {file.name for file in (PYTHON / "soilvdb").glob("*.py")}
    assert packaged == {file.name for file in (PYTHON / "soilvdb").iterdir() if file.is_file()}
