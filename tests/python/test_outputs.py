# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The guide's page on outputs names every figure, column and option that there is, and no other."""

import json
import re
import subprocess

import pytest
from test_guide import BUILD, ROOT, run_blocks

PAGE = ROOT / "tools/guide/outputs.md"


def names(section):
    """What stands in the first columns of a section's tables, a set for each table."""
    text = PAGE.read_text().split(f"\n## {section}\n")[1].split("\n## ")[0]
    tables = re.findall(r"^\|(?: key| column)[^\n]*\n\|[-|]+\n((?:\|[^\n]*\n)+)", text, flags=re.M)
    return [set(re.findall(r"`([^`]+)`", "".join(row.split("|")[1] for row in table.splitlines())))
            for table in tables]


def keys(value, path=""):
    if isinstance(value, dict):
        return set().union(*(keys(v, f"{path}.{k}" if path else k) for k, v in value.items()))
    if isinstance(value, list):
        return set().union(*(keys(v, path + "[]") for v in value))
    return {path}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("outputs")
    run_blocks(PAGE, where)
    return where


def test_keys_of_the_summary(folder):
    rigid, moving = (keys(json.loads((folder / f"out/{name}/summary.json").read_text()))
                     for name in ("rigid", "moving"))
    *tables, of_scans = names("summary.json")
    assert [rigid, moving - rigid] == tables
    assert of_scans == {"volume_m3.surveyed_removed", "volume_m3.surveyed_added", "mass_kg.surveyed",
                        "machines[].lip_error_m.mean", "machines[].lip_error_m.sigma"}
    assert rigid < moving


def test_columns_of_the_updates(folder):
    rigid, moving = ((folder / f"out/{name}/updates.csv").read_text().split("\n")[0].split(",")
                     for name in ("rigid", "moving"))
    *columns, of_forces = names("updates.csv")
    assert [set(rigid), set(moving) - set(rigid)] == columns
    assert of_forces == {"force_x_n", "force_y_n", "force_z_n", "moment_y_nm"}  # see test_force.py


def test_keys_of_a_comparison(folder):
    assert [keys(json.loads((folder / "deeper.json").read_text()))] == names("Compare two snapshots")


def test_deep_soil_is_air_in_a_snapshot_and_soil_in_a_closed_level_set(folder):
    vdb = pytest.importorskip("pyopenvdb")
    known = json.loads((folder / "out/deeper/summary.json").read_text())["voxel_size_m"]

    def values(file):
        """In the air, and 0.15 and 0.55 m below the floor of the dig, which is 0.45 m deep."""
        (grid,), _ = vdb.readAll(str(file))
        assert grid.gridClass == "level set" and grid.background == pytest.approx(3 * known)
        accessor = grid.getConstAccessor()
        return [accessor.getValue(tuple(map(round, grid.transform.worldToIndex((1.0, 0.0, z))))) / known
                for z in (0.3, -0.6, -1.0)]

    assert values(folder / "out/deeper/soil_final.vdb") == pytest.approx([3, -3, 3], abs=0.1)
    assert values(folder / "closed.vdb") == pytest.approx([3, -3, -3], abs=0.1)


def test_files_of_a_run(folder):
    table = PAGE.read_text().split("\n## ")[0]
    for file in (folder / "out/rigid").iterdir():
        named = re.sub("^soil_[0-9.]+[.]vdb$", "soil_20.vdb", file.name).replace(".glb", ".ply")
        assert f"`{named}`" in table


def test_commands_and_options():
    text = PAGE.read_text()

    def help_of(*command):
        return subprocess.run([BUILD / "soilvdb", *command, "--help"], text=True, check=True,
                              capture_output=True).stdout

    commands = re.findall(r"^  (\w+)  ", help_of().split("Subcommands:")[1], flags=re.M)
    assert len(commands) > 5
    for command in commands:
        assert f"| `soilvdb {command} " in text
        for option in re.findall(r"^  (?:-\w,)?(--[\w-]+)", help_of(command), flags=re.M):
            assert f"`{option}" in text, f"{command} {option}"
