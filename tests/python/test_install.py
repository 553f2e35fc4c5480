# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The module is of use where it is installed, and names the Python that it is built for."""

import os
import shutil
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest
from test_guide import BUILD

import soilvdb

PACKAGE = Path(soilvdb.__file__).parent
THIS = f"CPython {sys.version_info[0]}.{sys.version_info[1]}"


def import_from(folder, *options):
    return subprocess.run([sys.executable, *options, "-c", "import soilvdb; print(soilvdb.__file__)"], text=True,
                          cwd="/", env=dict(os.environ, PYTHONPATH=str(folder)), capture_output=True,
                          check=False)


@pytest.mark.parametrize("suffix, message", [
    (".cpython-38-x86_64-linux-gnu.so",
     f"soilvdb is built for CPython 3.8; this is {THIS} ({sys.executable}); start python3.8, or "),
    (EXTENSION_SUFFIXES[0].replace(".so", "-other.so"), "soilvdb is built for cpython-"),
    (None, "soilvdb has no compiled part in "),
])
def test_another_python_is_told_which_one_is_right(tmp_path, suffix, message):
    copy = tmp_path / "soilvdb"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    if suffix:
        (copy / f"_soilvdb{suffix}").touch()
    done = import_from(tmp_path)
    last = done.stderr.splitlines()[-1]
    assert done.returncode != 0 and last.startswith(f"ImportError: {message}"), done.stderr


def test_a_python_without_numpy_is_told_what_to_do():
    done = import_from(PACKAGE.parent, "-S")  # without the folders that have packages
    last = done.stderr.splitlines()[-1]
    assert done.returncode != 0 and last == (
        f"ImportError: soilvdb needs NumPy, which {sys.executable} does not have; install it: "
        f"{sys.executable} -m pip install numpy, or for the system's Python apt-get install "
        "python3-numpy")


def test_parts_are_installed_alone(tmp_path):
    for component in ("program", "python"):
        subprocess.run(["cmake", "--install", BUILD, "--component", component, "--prefix", tmp_path],
                       check=True, capture_output=True)
    found = {path.relative_to(tmp_path).parts[0] for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {"bin", "lib", "share"}
    done = import_from(tmp_path / "lib/python3/dist-packages")
    assert done.stdout.strip() == str(tmp_path / "lib/python3/dist-packages/soilvdb/__init__.py")
    version = subprocess.run([tmp_path / "bin/soilvdb", "--version"], check=True, text=True,
                             capture_output=True).stdout
    assert soilvdb.__version__ in version
