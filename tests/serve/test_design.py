# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Volumes between surfaces: what can't be compared is told, and of what was compared the area."""

import json
import subprocess
import urllib.request
import zlib

import numpy as np
import pytest
import soilvdb
from live import PROGRAM, Server

VOXEL = 0.25


def raster(path, heights, first=(100.5, 200.5), crs="EPSG:25832"):
    """Writes cells of 1 m. @param heights of posts, rows from the south"""
    plain = path.with_name("plain.tif")
    soilvdb.write_raster(plain, np.asarray(heights, np.float32), first, (1, 1))
    subprocess.run(["gdal_translate", "-q", *(["-a_srs", crs] if crs else []), plain, path], check=True)
    return path


@pytest.fixture(name="site")
def _site(tmp_path):
    """40 m x 40 m of level ground at 10 m, from (100, 200); the cells of its last four columns have none."""
    heights = np.full((40, 40), 10.0)
    heights[:, 36:] = np.nan
    raster(tmp_path / "ground.tif", heights)
    path = tmp_path / "site.yaml"
    path.write_text(f"soilvdb: 1\nvoxel_size: {VOXEL}\nterrain: {{raster: ground.tif}}\n"
                    "machines: [{name: d, bucket: {width: 2.0, height: 1.0}}]\n")
    return path


def served(site, design=None):
    more = ("--design", design) if design else ()
    return Server(site, *more, "--out", site.parent / "out", cwd=site.parent)


def box(x0, y0, x1, y1):
    return f"/volume?boundary={x0},{y0},{x1},{y0},{x1},{y1},{x0},{y1}"


def refused(server, path):
    status, body = server.get(path)
    assert status == 400
    return body.decode()


def test_the_area_is_that_of_what_was_compared(site, tmp_path):
    half = np.full((40, 40), 9.0)
    half[:, 20:] = np.nan
    with served(site, raster(tmp_path / "half.tif", half)) as server:
        all_designed = server.json(box(105, 205, 115, 215))
        assert all_designed["area_m2"] == pytest.approx(100)
        assert all_designed["design_area_m2"] == pytest.approx(100)
        assert all_designed["to_cut_m3"] == pytest.approx(100)
        assert (all_designed["off_site_m2"], all_designed["to_fill_m3"]) == (0, 0)
        # The last post of the design is at 119.5, that of the ground at 135.5.
        partly = server.json(box(110, 205, 130, 215))
        assert partly["area_m2"] == pytest.approx(200)
        assert partly["design_area_m2"] == pytest.approx(95, abs=10 * VOXEL)
        assert partly["to_cut_m3"] == pytest.approx(partly["design_area_m2"])
        none = server.json(box(122, 205, 130, 215))
        assert (none["to_cut_m3"], none["to_fill_m3"], none["design_area_m2"]) == (None, None, 0)
        beyond = server.json(box(130, 205, 150, 215))
        assert beyond["area_m2"] == pytest.approx(55, abs=10 * VOXEL)
        assert beyond["area_m2"] + beyond["off_site_m2"] == pytest.approx(200)
        tiny = server.json(box(105, 205, 105.01, 205.01))
        assert tiny["to_cut_m3"] == pytest.approx(1e-4) and tiny["area_m2"] == pytest.approx(1e-4)


def test_boundaries_without_sense_are_refused(site):
    with served(site) as server:
        assert "no ground inside the boundary: the terrain goes from 10" in refused(server, box(12, 205, 20, 215))
        assert "no ground inside" in refused(server, box(137, 205, 139, 215)), "voids"
        assert "crosses itself" in refused(server, "/volume?boundary=105,205,115,215,115,205,105,215")
        # Sides that touch don't cross: a ring, cut open.
        ring = "105,205,115,205,115,215,105,215,105,205,108,208,108,212,112,212,112,208,108,208"
        assert server.json("/volume?boundary=" + ring)["area_m2"] == pytest.approx(100 - 16)


@pytest.mark.parametrize(("crs", "said"), [
    ("EPSG:25832", ""),
    ("EPSG:25833", "coordinates of the terrain are in EPSG:25832, and those of the design"),
    ("EPSG:25832+5783", "heights of the design"),
    ("", "coordinates of the terrain are in EPSG:25832, and the design"),
])
def test_other_coordinates_are_told(site, tmp_path, crs, said):
    design = raster(tmp_path / "plan.tif", np.full((40, 40), 9.0), crs=crs)
    with served(site, design) as server:
        told = [line for line in server.stop().splitlines() if "warning" in line]
    assert len(told) == (1 if said else 0)
    assert all(said in line for line in told)


def cone(path, corners=90, radius=8.0, depth=3.0, middle=(118.0, 220.0), top=10.0, unit=1.0, name="pit", crs="25832"):
    """Writes a pit in the shape of a cone as LandXML. @return its volume and the area of its rim"""
    angles = np.arange(corners) * 2 * np.pi / corners
    rim = np.c_[middle[0] + radius * np.cos(angles), middle[1] + radius * np.sin(angles), np.full(corners, top)]
    points = np.vstack([rim, [*middle, top - depth]]) / unit
    metric = '<Metric linearUnit="meter"/>' if unit == 1 else '<Imperial linearUnit="USSurveyFoot"/>'
    path.write_text(
        '<?xml version="1.0"?><LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">'
        f'<Units>{metric}</Units>' + (f'<CoordinateSystem epsgCode="{crs}"/>' if crs else "")
        + f'<Surfaces><Surface name="{name}"><Definition surfType="TIN"><Pnts>'
        + "".join(f'<P id="{n}">{y} {x} {z}</P>' for n, (x, y, z) in enumerate(points))
        + "</Pnts><Faces>" + "".join(f"<F>{n} {(n + 1) % corners} {corners}</F>" for n in range(corners))
        + "</Faces></Definition></Surface></Surfaces></LandXML>")
    area = corners / 2 * radius**2 * np.sin(2 * np.pi / corners)
    return area * depth / 3, area


@pytest.mark.parametrize("unit", [1.0, 1200 / 3937])
def test_a_surface_of_triangles_is_a_design(site, tmp_path, unit):
    volume, area = cone(tmp_path / "pit.xml", unit=unit, crs="25832" if unit == 1 else "")
    with served(site, "pit.xml#pit") as server:
        left = server.json(box(105, 205, 132, 235))
        place = server.json("/height?x=114&y=220")
        told = [line for line in server.stop().splitlines() if "the design" in line]
    assert left["to_cut_m3"] == pytest.approx(volume, rel=2e-3) and left["to_fill_m3"] == 0
    # Posts are 1/32 m apart, and what is between the last of them and the rim has no height.
    assert area - 2 * np.pi * 8 / 32 * np.sqrt(2) < left["design_area_m2"] < area + 0.1
    assert place["design_m"] == pytest.approx(10 - 3 * (1 - 4 / 8 / np.cos(np.pi / 90)), abs=0.01)
    assert len(told) == (unit != 1) and all("and the design pit.xml#pit names none" in line for line in told)


def test_a_design_of_several_surfaces_or_elsewhere_is_told(site, tmp_path):
    cone(tmp_path / "far.xml", crs="25833")
    with served(site, "far.xml") as server:
        assert "those of the design far.xml in EPSG:25833" in server.stop()
    text = (tmp_path / "far.xml").read_text()
    surface = text[text.index("<Surface "):text.index("</Surfaces>")]
    (tmp_path / "two.xml").write_text(text.replace("</Surfaces>", surface.replace("pit", "deep") + "</Surfaces>"))
    refusal = subprocess.run([PROGRAM, "serve", site, "--port", "0", "--design", "two.xml"], cwd=tmp_path, text=True,
                             capture_output=True, check=False)
    assert refusal.returncode == 2
    assert "two.xml: has 2 surfaces, 'pit' and 'deep'; name one, as in two.xml#pit" in refusal.stderr.splitlines()[-1]


def test_lines_of_a_design_are_brought_to_the_site(site, tmp_path):
    def line(*places):
        return {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": places}}
    (tmp_path / "plan.geojson").write_text(json.dumps({
        "type": "FeatureCollection", "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}},
        "features": [line((101, 201), (111, 201)), line((105, 205, 12.5), (105, 215, 13)), line((134, 210), (138.8, 210))]}))
    subprocess.run(["ogr2ogr", "-t_srs", "EPSG:4326", "plan.gpkg", "plan.geojson"], cwd=tmp_path, check=True)
    for file in ("plan.geojson", "plan.gpkg"):
        with Server(site, "--lines", file, "--out", tmp_path / file[-4:], cwd=tmp_path) as server:
            on_ground, given, at_rim = server.json("/lines")["lines"]
            asked = urllib.request.Request(server.url.rstrip("/") + "/lines", headers={"Accept-Encoding": "deflate"})
            with urllib.request.urlopen(asked) as reply:
                assert json.loads(zlib.decompress(reply.read()))["lines"] == [on_ground, given, at_rim]
                tag = reply.headers["ETag"]
            assert server.get("/lines", {"If-None-Match": tag}) == (304, b""), "it was made once"
            assert not [line for line in server.stop().splitlines() if file in line and "warning" in line]
        # Each half metre or less on the ground, whose last posts are at 135.5 m.
        np.testing.assert_allclose(on_ground, [(101 + k / 2, 201, 10) for k in range(21)], atol=2e-3)
        np.testing.assert_allclose(given, [(105, 205, 12.5), (105, 215, 13)], atol=2e-3)
        assert at_rim[0] == pytest.approx([134, 210, 10], abs=2e-3) and at_rim[-1][0] == pytest.approx(135.44, abs=2e-3)
    with served(site) as server:
        status, body = server.get("/lines")
        assert status == 404 and b"takes some by --lines" in body
    plane = tmp_path / "plane.yaml"
    plane.write_text(site.read_text().replace("raster: ground.tif", "plane: {z: 0.0}"))
    refusal = subprocess.run([PROGRAM, "serve", plane, "--port", "0", "--lines", "plan.gpkg"], cwd=tmp_path, text=True,
                             capture_output=True, check=False)
    assert refusal.returncode == 2
    assert "plan.gpkg: has coordinates in EPSG:4326, and the terrain has no CRS" in refusal.stderr.splitlines()[-1]


def test_alignments_of_landxml_are_drawn_with_their_profile(site, tmp_path):
    (tmp_path / "road.xml").write_text(
        '<?xml version="1.0"?><LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">'
        '<Units><Metric linearUnit="meter"/></Units><CoordinateSystem epsgCode="25832"/><Alignments>'
        '<Alignment name="axis" staStart="0"><CoordGeom><Line><Start>210 105</Start><End>210 115</End></Line>'
        '<Curve rot="ccw"><Start>210 115</Start><Center>220 115</Center><End>220 125</End></Curve></CoordGeom>'
        '<Profile><ProfAlign name="design"><PVI>0 10</PVI><PVI>100 20</PVI></ProfAlign></Profile></Alignment>'
        '<Alignment name="plan"><CoordGeom><Line><Start>205 105</Start><End>205 106</End></Line></CoordGeom></Alignment>'
        '</Alignments></LandXML>')
    with Server(site, "--lines", "road.xml", cwd=tmp_path) as server:
        road, plan = server.json("/lines")["lines"]
        assert not [line for line in server.stop().splitlines() if "road.xml" in line and "warning" in line]
    x, y, z = np.transpose(road)
    along = np.where(x <= 115, x - 105, 10 + 10 * np.arctan2(x - 115, 220 - y))
    np.testing.assert_allclose(z, 10 + along / 10, atol=2e-3)
    np.testing.assert_allclose(np.hypot(x - 115, y - 220)[x > 115], 10, atol=2e-3)
    assert along[-1] == pytest.approx(10 + 5 * np.pi, abs=2e-3) and len(road) > 10
    np.testing.assert_allclose(plan, [(105 + k / 2, 205, 10) for k in range(3)], atol=2e-3)


def test_arcs_of_lines_are_drawn(site, tmp_path):
    (tmp_path / "arc.csv").write_text(
        'id,WKT\n1,"COMPOUNDCURVE((101 201, 103 201), CIRCULARSTRING(103 201, 104 202, 105 201))"\n')
    subprocess.run(["ogr2ogr", "-a_srs", "EPSG:25832", "-nlt", "COMPOUNDCURVE", "arc.gpkg", "arc.csv"], cwd=tmp_path, check=True)
    with Server(site, "--lines", "arc.gpkg", "--out", tmp_path / "out", cwd=tmp_path) as server:
        [line] = np.array(server.json("/lines")["lines"])
        arc = line[line[:, 0] > 103.001]
        assert len(arc) > 10 and arc[-1, 0] == pytest.approx(105, abs=2e-3)
        np.testing.assert_allclose(np.hypot(arc[:, 0] - 104, arc[:, 1] - 201), 1, atol=5e-3)


def test_lines_of_a_dxf_are_in_its_unit(site, tmp_path):
    def line(*places):
        values = [(10 * axis + 10 + n, v / 0.3048) for n, place in enumerate(places) for axis, v in enumerate(place)]
        return "".join(f"{code}\n{value}\n" for code, value in [(0, "LINE"), (8, "0"), *values])
    head = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n2\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n"
    (tmp_path / "plan.dxf").write_text(
        head + line((101, 201, 0), (101.5, 201, 0)) + line((105, 205, 0), (105, 215, 13)) + "0\nENDSEC\n0\nEOF\n")
    with Server(site, "--lines", "plan.dxf", "--out", tmp_path / "out", cwd=tmp_path) as server:
        on_ground, given = server.json("/lines")["lines"]
    np.testing.assert_allclose(on_ground, [(101, 201, 10), (101.5, 201, 10)], atol=1e-3)
    np.testing.assert_allclose(given, [(105, 205, 0), (105, 215, 13)], atol=1e-3)
