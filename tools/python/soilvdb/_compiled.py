# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Refuses a Python that the compiled part was not built for, and one without NumPy. Any Python 3.7 can
read this file."""

from __future__ import annotations

import platform
import re
import sys
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path

NAME = "_soilvdb"


def check(folder: Path) -> None:
    if any((folder / (NAME + suffix)).exists() for suffix in EXTENSION_SUFFIXES):
        if find_spec("numpy") is None:
            raise ImportError(f"soilvdb needs NumPy, which {sys.executable} does not have; install it: "
                              f"{sys.executable} -m pip install numpy, or for the system's Python "
                              "apt-get install python3-numpy")
        return
    this = f"{platform.python_implementation()} {sys.version_info[0]}.{sys.version_info[1]}"
    tags = sorted(file.name.split(".")[1] for file in folder.glob(f"{NAME}.*.so"))
    if not tags:
        raise ImportError(f"soilvdb has no compiled part in {folder}; build it with tools/build")
    versions = [re.sub(r"^cpython-(\d)(\d+).*", r"CPython \1.\2", tag) for tag in tags]
    if this in versions:  # another processor, or a debug build
        versions, this = tags, f"{this}, {EXTENSION_SUFFIXES[0].split('.')[1]}"
        remedies = []
    else:
        remedies = [f"start {versions[-1].lower().replace('cpython ', 'python')}"]
    if sys.version_info >= (3, 9):
        remedies.append(f"build a wheel with this one: {sys.executable} -m pip wheel tools/python")
    raise ImportError(f"soilvdb is built for {', '.join(versions)}; this is {this} "
                      f"({sys.executable}); {', or '.join(remedies)}")


check(Path(__file__).resolve().parent)
