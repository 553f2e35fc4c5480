# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Motions, rasters and scans as arrays."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

import soilvdb

DATA = Path(__file__).resolve().parents[2] / "data"


def test_a_site_fed_the_motions_of_a_scenario_is_where_its_run_ends(tmp_path):
    motions = soilvdb.motions(DATA / "half_sine.yaml")
    assert list(motions) == soilvdb.Site.open(DATA / "half_sine.yaml").machines
    site = soilvdb.Site.open(DATA / "half_sine.yaml")
    for name, rows in motions.items():
        site.update_path(name, **rows)
    summary = soilvdb.run(DATA / "half_sine.yaml", tmp_path / "out")
    assert f"{site.ground_hash():016x}" == summary["state_hash"]


def test_motions_of_joints_and_long_ones(tmp_path):
    joints = soilvdb.motions(DATA / "excavator.yaml")["excavator"]
    table = np.loadtxt(DATA / "excavator.csv", delimiter=",", skiprows=1)
    assert joints["times"] == pytest.approx(table[:, 0])
    assert joints["joints"].shape == (len(table), 4)
    count = 40_000  # several parts
    t = np.arange(count) / 100
    np.savetxt(tmp_path / "long.csv", np.column_stack([t, np.sin(t / 50), np.cos(t / 50), t * 0]),
               delimiter=",", header="time,x,y,z", comments="")
    (tmp_path / "long.yaml").write_text(
        "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: -5.0}}\nmachines:\n"
        "  - {name: m, bucket: {width: 1, height: 1}, motion: long.csv}\n")
    rows = soilvdb.motions(tmp_path / "long.yaml")["m"]
    assert rows["times"] == pytest.approx(t) and (np.diff(rows["times"]) > 0).all()
    assert rows["positions"][:, 0] == pytest.approx(np.sin(t / 50), abs=1e-9)
    assert rows["rotations"] == pytest.approx(np.tile([0, 0, 0, 1.0], (count, 1)))


def test_motions_end_where_a_run_stops(tmp_path):
    (tmp_path / "a.csv").write_text("time,x,y,z\n0,0,0,0\n1,1,0,0\n2,nan,0,0\n3,3,0,0\n")
    (tmp_path / "b.csv").write_text("time,x,y,z\n0,0,5,0\n1,1,5,0\n2,2,5,0\n3,3,5,0\n")
    text = ("soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0}}\nmachines:\n"
            "  - {name: a, bucket: {width: 1, height: 1}, motion: a.csv, bad_rows: %s}\n"
            "  - {name: b, bucket: {width: 1, height: 1}, motion: b.csv}\n"
            "  - {name: c, bucket: {width: 1, height: 1}}\n")
    (tmp_path / "s.yaml").write_text(text % "stop")
    assert [m["times"].tolist() for m in soilvdb.motions(tmp_path / "s.yaml").values()] == [
        [0, 1], [0, 1]]
    (tmp_path / "s.yaml").write_text(text % "skip")
    assert [m["times"].tolist() for m in soilvdb.motions(tmp_path / "s.yaml").values()] == [
        [0, 1, 3], [0, 1, 2, 3]]
    (tmp_path / "s.yaml").write_text(text.replace("width", "widht", 1) % "stop")
    with pytest.raises(ValueError, match="s.yaml:5: .*widht"):
        soilvdb.motions(tmp_path / "s.yaml")


def test_doubtful_heights_are_warned_of(tmp_path):
    soilvdb.write_raster(tmp_path / "a.tif", np.full((9, 9), 7.0), (0.5, 0.5), (1, 1))
    subprocess.run(["gdal_translate", "-q", "-ot", "Byte", "-a_nodata", "0", tmp_path / "a.tif",
                    tmp_path / "plain.tif"], check=True)
    grey = tmp_path / "grey.asc"  # GeoTIFFs of ours say that their heights are in metres
    subprocess.run(["gdal_translate", "-q", "-of", "ENVI", tmp_path / "plain.tif", grey], check=True)
    with pytest.warns(UserWarning, match="8-bit greys"):
        soilvdb.read_raster(grey)
    with pytest.warns(UserWarning, match="8-bit greys"):
        soilvdb.Site(0.5, soilvdb.raster(grey), [soilvdb.Bucket(1, 1)])


def test_rasters_come_back_as_they_were_written(tmp_path):
    heights = np.random.default_rng(1).normal(size=(30, 20))
    heights[3, 4] = np.nan
    soilvdb.write_raster(tmp_path / "a.tif", heights, (512000.25, 5400000.5), (0.5, 0.25),
                         band="error")
    back, first, spacing, crs = soilvdb.read_raster(tmp_path / "a.tif")
    assert back == pytest.approx(heights.astype(np.float32), nan_ok=True)
    assert (first, spacing, crs) == ((512000.25, 5400000.5), (0.5, 0.25), "")
    part, first, _, _ = soilvdb.read_raster(tmp_path / "a.tif",
                                            (512001.3, 5400001.0, 512002.7, 5400001.9))
    # Posts at 1.25 .. 2.75 in x are 2 to 5 after the first, and 2 to 6 in y.
    assert first == (512001.25, 5400001.0)
    assert part == pytest.approx(back[2:7, 2:6], nan_ok=True)
    said = subprocess.run(["gdalinfo", tmp_path / "a.tif"], capture_output=True, text=True,
                          check=False).stdout if Path("/usr/bin/gdalinfo").exists() else "error"
    assert "error" in said
    site = soilvdb.Site(0.1, soilvdb.raster(tmp_path / "a.tif"), [soilvdb.Bucket(1, 1)])
    assert site.heights([[512000.25 + 5, 5400000.5 + 5]])[0] == pytest.approx(heights[20, 10], abs=1e-6)


@pytest.mark.parametrize("arguments, why", [
    (([[1.0]], (0, 0), (1, 1)), "heights must have the shape (ny, nx)"),
    ((np.zeros((3, 3)), (0, float("inf")), (1, 1)), "first must be finite"),
    ((np.zeros((3, 3)), (0, 0), (0, 1)), "first must be finite, and spacing more than 0"),
    ((np.zeros((3, 3)), (0,), (1, 1)), "first")])
def test_wrong_rasters_are_told(tmp_path, arguments, why):
    with pytest.raises(ValueError) as error:
        soilvdb.write_raster(tmp_path / "x.tif", *arguments)
    assert str(error.value).startswith(why)
    assert not (tmp_path / "x.tif").exists()
    with pytest.raises(ValueError, match="none.tif"):
        soilvdb.read_raster(tmp_path / "none.tif")
    with pytest.raises(RuntimeError, match="no/such/folder"):
        soilvdb.write_raster(tmp_path / "no/such/folder/x.tif", np.zeros((3, 3)), (0, 0), (1, 1))


@pytest.mark.parametrize("given", [{"pours": [soilvdb.Pour((0, 0, 2), 0.5, (0, 1))]},
                                   {"hoppers": [soilvdb.Hopper((0, 0, 1, 1), 1.0)]}])
def test_soil_that_comes_or_goes_needs_soil_that_moves(given):
    with pytest.raises(ValueError, match=r"pours and hoppers .* give soil=Soil\(repose_angle=..\) as well"):
        soilvdb.Site(0.1, soilvdb.plane(0.0), [], **given)


def test_ledgers_of_a_site_say_what_fell(tmp_path):
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)],
                        soil=soilvdb.Soil(repose_angle=0.6),
                        pours=[soilvdb.Pour((0, 0, 2), 0.5, (0, 1))])
    site.pour(2)
    site.come_to_rest()
    ledger = site.ledger()
    assert ledger["poured_m3"] == pytest.approx(0.5, rel=1e-4)
    assert ledger["fill_m3"] == pytest.approx(site.change_m3(), abs=1e-9)
    assert ledger["hauled_m3"] == 0 and ledger["slid_m3"] >= 0
    assert "poured_m3" not in site.ledger(0)


def test_points_of_scans_are_rows(tmp_path):
    xyz = np.random.default_rng(2).normal(size=(50, 3)) + [5e5, 5.4e6, 100]
    np.savetxt(tmp_path / "a.xyz", xyz, fmt="%.17g")
    assert (soilvdb.points(tmp_path / "a.xyz") == xyz).all()
    header = ("ply\nformat binary_big_endian 1.0\nelement vertex 50\nproperty double x\n"
              "property double y\nproperty double z\nend_header\n")
    (tmp_path / "a.ply").write_bytes(header.encode() + xyz.astype(">f8").tobytes())
    points = soilvdb.points(str(tmp_path / "a.ply"))
    assert (points == xyz).all() and points.dtype == np.float64
    (tmp_path / "a.csv").write_text("0,0,0\nnan,1,1\n")
    assert soilvdb.points(tmp_path / "a.csv").shape == (0, 3)


def test_wrong_scans_are_refused_in_one_line(tmp_path):
    (tmp_path / "a.xyz").write_text("1 2 3\n4 5\n")
    with pytest.raises(ValueError, match=r"a\.xyz:2: has 2 columns; at least 3 are needed"):
        soilvdb.points(tmp_path / "a.xyz")
    (tmp_path / "b.e57").write_bytes(b"ASTM-E57" + bytes(99))
    with pytest.raises(ValueError, match="pdal translate b.e57 b.las"):
        soilvdb.points(tmp_path / "b.e57")
    (tmp_path / "c.ply").write_bytes(b"\xff\xfe\n")
    with pytest.raises(ValueError, match=r"c\.ply: is not a ply file: at byte 0 it begins with"):
        soilvdb.points(tmp_path / "c.ply")
