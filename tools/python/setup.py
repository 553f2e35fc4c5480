# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Builds the module's compiled part with CMake, which also sets the version.

The build folder is build-wheel, beside build, so that ccache finds the objects of build. If
SOILVDB_BUILD_DIR is set, the compiled part comes from that build folder instead.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build-wheel"
CMAKE = (ROOT / "CMakeLists.txt").read_text()


def pybind11_dir():
    """pip's pybind11 for CMake, which otherwise finds the system's."""
    try:
        import pybind11
    except ImportError:
        return []
    return [f"-Dpybind11_DIR={pybind11.get_cmake_dir()}"]


def build_module():
    # The cache names tools of pip's environment, which differs each time.
    (BUILD / "CMakeCache.txt").unlink(missing_ok=True)
    subprocess.run(
        ["cmake", "-G", "Ninja", "-S", ROOT, "-B", BUILD, "-DCMAKE_BUILD_TYPE=Release",
         f"-DPython3_EXECUTABLE={sys.executable}", "-DSOILVDB_TOOLS=OFF", "-DSOILVDB_TESTS=OFF",
         "-DSOILVDB_BENCH=OFF", *pybind11_dir(), *shlex.split(os.environ.get("CMAKE_ARGS", ""))],
        check=True)
    subprocess.run(["cmake", "--build", BUILD, "--target", "soilvdb_python",
                    "--parallel", str(os.cpu_count())], check=True)


class CMakeBuild(build_ext):
    def build_extension(self, ext):
        built = os.environ.get("SOILVDB_BUILD_DIR")
        if not built:
            build_module()
        module = Path(self.get_ext_filename(ext.name)).name   # for this Python
        target = Path(self.get_ext_fullpath(ext.name))
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(Path(built or BUILD) / "python/soilvdb" / module, target)


BUILD.mkdir(exist_ok=True)
shutil.rmtree(BUILD / "setuptools", ignore_errors=True)   # it would keep files that are gone
setup(
    version=re.search(r"^project\(soilvdb VERSION ([0-9.]+)", CMAKE, flags=re.M)[1],
    ext_modules=[Extension("soilvdb._soilvdb", [])],
    cmdclass={"build_ext": CMakeBuild},
    options={"build": {"build_base": str(BUILD / "setuptools")}, "egg_info": {"egg_base": str(BUILD)}},
)
