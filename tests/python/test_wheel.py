# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A wheel has all that the module is made of, says its version, and is of use where it is unpacked."""

import os
import re
import subprocess
import sys
import zipfile
from email.parser import HeaderParser

import pytest
from test_guide import BUILD, ROOT

PYTHON = ROOT / "tools/python"
DIG = """
import numpy, soilvdb
site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(width=1.0, height=0.5)])
for x in numpy.linspace(0, 2, 21):
    update = site.update(0, position=(x, 0.0, -0.2))
print(soilvdb.__file__, soilvdb.__version__, round(update.bucket_m3, 3))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Made as pip makes it, but of what is built already."""
    to = tmp_path_factory.mktemp("wheel")
    make = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    done = subprocess.run([sys.executable, "-c", make, to], cwd=PYTHON, check=False, text=True,
                          env=dict(os.environ, SOILVDB_BUILD_DIR=str(BUILD)), capture_output=True)
    assert done.returncode == 0, done.stderr
    made = list(to.glob("*.whl"))
    assert len(made) == 1
    return made[0]


def version():
    return re.search(r"project\(soilvdb VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]


def test_it_has_all_files_and_no_other(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        metadata, kind = (HeaderParser().parsestr(archive.read(
            f"soilvdb-{version()}.dist-info/{name}").decode()) for name in ("METADATA", "WHEEL"))
    sources = {str(file.relative_to(PYTHON)) for file in (PYTHON / "soilvdb").rglob("*.*")
               if file.suffix != ".pyc"}
    assert {"soilvdb/__init__.py", "soilvdb/fleet/__main__.py", "soilvdb/_soilvdb.pyi", "soilvdb/py.typed"} <= sources
    compiled = [name for name in names - sources if re.fullmatch(r"soilvdb/_soilvdb\..*\.so", name)]
    assert names - sources == set(compiled) and sources <= names and len(compiled) == 1
    assert metadata["Name"] == "soilvdb" and metadata["Version"] == version()
    assert metadata.get_all("Requires-Dist") == [
        "numpy", *(f"{name} ; extra == 'fleet'" for name in ("distributed", "matplotlib", "pyyaml"))]
    assert metadata["Requires-Python"] == ">=3.9"
    tag = f"cp{sys.version_info.major}{sys.version_info.minor}"
    assert kind["Root-Is-Purelib"] == "false" and kind["Tag"].startswith(f"{tag}-{tag}-linux_")


def test_it_digs_from_where_it_is(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path)
    out = subprocess.run([sys.executable, "-c", DIG], cwd="/", text=True, check=True,
                         capture_output=True, env=dict(os.environ, PYTHONPATH=str(tmp_path))).stdout
    assert out.split() == [str(tmp_path / "soilvdb/__init__.py"), version(), "0.4"]


def test_the_sources_stay_as_they_were(wheel):
    found = {path.name for folder in (PYTHON, ROOT) for path in folder.iterdir()}
    assert wheel.exists() and not found & {"dist", "soilvdb.egg-info"}
    assert not (PYTHON / "build").exists()


@pytest.mark.skipif("SOILVDB_OTHER_PYTHON" not in os.environ,
                    reason="SOILVDB_OTHER_PYTHON names another CPython, with headers and setuptools")
def test_another_python_builds_its_own(tmp_path):
    """By setup.py, as pip does. What it needs no NumPy for works at once; without it that is what misses."""
    other = os.environ["SOILVDB_OTHER_PYTHON"]
    assert version_of(other) != version_of(sys.executable) and version_of(other)[0] == 3
    subprocess.run([other, "setup.py", "build", "--build-lib", tmp_path], cwd=PYTHON, check=True)
    suffix = said(other, "import sysconfig; print(sysconfig.get_config_var('EXT_SUFFIX'))")
    module, = (tmp_path / "soilvdb").glob("_soilvdb.*.so")
    assert module.name == "_soilvdb" + suffix
    alone = f"""
from importlib.util import module_from_spec, spec_from_file_location
spec = spec_from_file_location("soilvdb._soilvdb", {str(module)!r})
soilvdb = module_from_spec(spec)
spec.loader.exec_module(soilvdb)
print(soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(width=1.0, height=0.5)]).change_m3())
"""
    assert said(other, alone) == "0.0"
    env = dict(os.environ, PYTHONPATH=str(tmp_path))
    done = subprocess.run([other, "-c", DIG], cwd="/", text=True, check=False, capture_output=True, env=env)
    if said(other, "from importlib.util import find_spec; print(find_spec('numpy') is not None)") == "True":
        assert done.stdout.split() == [str(tmp_path / "soilvdb/__init__.py"), version(), "0.4"]
    else:
        assert "No module named 'numpy'" in done.stderr
        done = subprocess.run([other, "-c", "import soilvdb"], cwd="/", text=True, check=False,
                              capture_output=True, env=env)
        assert done.stderr.splitlines()[-1].startswith("ImportError: soilvdb needs NumPy")


def said(python, code):
    return subprocess.run([python, "-c", code], cwd="/", text=True, check=True, capture_output=True).stdout.strip()


def version_of(python):
    return tuple(map(int, said(python, "import sys; print(*sys.version_info[:2])").split()))
