# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Terrain from arrays, sites far from the world's origin, and volumes inside boundaries."""

import json
import pickle
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import soilvdb

PROGRAM = Path(soilvdb.__file__).parents[2] / "soilvdb"
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
LOAM = soilvdb.Soil(repose_angle=0.61, swell=0.25)


def site_on(terrain, soil=None, **options):
    return soilvdb.Site(0.1, terrain, [soilvdb.Bucket(1.2, 0.9, PROFILE)], soil=soil, **options)


def hills(seed=0, shape=(30, 40)):
    return np.random.default_rng(seed).normal(0, 0.05, shape).cumsum(0).cumsum(1).astype(np.float32)


def test_an_array_is_the_raster_of_its_file(tmp_path):
    heights = hills()
    heights[3:5, 30:] = np.nan
    soilvdb.write_raster(tmp_path / "hills.tif", heights, (-10.25, -8.5), (0.5, 0.5))
    sites = [site_on(terrain) for terrain in (
        soilvdb.raster(tmp_path / "hills.tif"),
        soilvdb.raster(heights, origin=(-10.25, -8.5), cell=0.5),
        pickle.loads(pickle.dumps(soilvdb.raster(heights.tolist(), origin=(-10.25, -8.5), cell=0.5))))]
    xy = np.random.default_rng(1).uniform((-10.5, -9), (9.5, 6.5), (500, 2))
    wanted = sites[0].heights(xy)
    assert np.isnan(wanted).any() and np.isfinite(wanted).sum() > 400
    for site in sites:
        np.testing.assert_array_equal(site.heights(xy), wanted)
        top = site.heights([(-4, 0)])[0]
        site.update_path(0, positions=[(-6 + 0.1 * i, 0, top - 0.3) for i in range(40)])
    assert len({site.ground_hash() for site in sites}) == 1
    assert sites[1].heights([(-10.25, -8.5), (9.25, 6)]) == pytest.approx(
        [heights[0, 0], heights[-1, -1]], abs=1e-6)
    again = pickle.loads(pickle.dumps(sites[1]))
    assert again.save() == sites[1].save()


def test_a_snapshot_of_an_arrays_site_is_complete(tmp_path):
    site = site_on(soilvdb.raster(hills(), origin=(-10, -8), cell=0.5))
    top = site.heights([(0, 0)])[0]
    site.update_path(0, positions=[(0.1 * i, 0, top - 0.4) for i in range(30)])
    (tmp_path / "a").mkdir()
    site.write(tmp_path / "a" / "now.vdb")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == [
        "now.vdb", made := next((tmp_path / "a").glob("terrain_*.tif")).name]
    (tmp_path / "a").rename(tmp_path / "b")  # both files move together
    told = subprocess.run([PROGRAM, "info", tmp_path / "b" / "now.vdb"], capture_output=True, text=True,
                          check=True).stdout
    assert made in told and "good" in told
    again = site_on(soilvdb.snapshot(tmp_path / "b" / "now.vdb"))
    assert again.ground_hash() == site.ground_hash()
    with pytest.raises(ValueError, match="write it to a GeoTIFF"):
        site_on(soilvdb.raster(hills(), origin=(-10, -8), cell=0.5)).record(tmp_path / "record")
    assert not (tmp_path / "record").exists()


@pytest.mark.parametrize("soil", [None, LOAM], ids=["rigid", "moving"])
def test_a_first_state_needs_ground_as_well(soil):
    heights = np.zeros((21, 21))
    heights[:, 15:] = np.nan
    site = site_on(soilvdb.raster(heights, origin=(-10, -10), cell=1.0), soil)
    before = site.save()
    for place in ((7, 0, -0.5), (0, -10, -0.5), (30, 0, -0.5)):
        with pytest.raises(soilvdb.NoGroundError, match="without a height"):
            site.update(0, position=place)
        assert site.save() == before
    site.update(0, position=(7, 0, 2.0))  # in the air
    site.update(0, position=(0, 0, 2.0))


@pytest.mark.parametrize("call, error, message", [
    (lambda: soilvdb.raster(hills()), TypeError, "origin .* and cell must be given"),
    (lambda: soilvdb.raster("a.tif", cell=1.0), TypeError, "leave them out"),
    (lambda: soilvdb.raster(hills()[0], origin=(0, 0), cell=1), ValueError, "shape .ny, nx."),
    (lambda: soilvdb.raster(hills()[:1], origin=(0, 0), cell=1), ValueError, "each 2 or more"),
    (lambda: soilvdb.raster(hills(), origin=(0, 0), cell=0), ValueError, "more than 0"),
    (lambda: soilvdb.raster(hills(), origin=(0, np.inf), cell=1), ValueError, "finite"),
    (lambda: soilvdb.raster(hills() + 2e5, origin=(0, 0), cell=1), ValueError, "within 1e5 m"),
    (lambda: soilvdb.raster(hills() * np.inf, origin=(0, 0), cell=1), ValueError, "1e5|not nan"),
    (lambda: soilvdb.raster(hills() * np.nan, origin=(0, 0), cell=1), ValueError, "is not nan"),
    (lambda: soilvdb.raster([["a"]], origin=(0, 0), cell=1), TypeError, "numbers"),
])
def test_arrays_that_are_no_terrain_are_refused(call, error, message):
    with pytest.raises(error, match=message) as told:
        call()
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("soil", [None, LOAM], ids=["rigid", "moving"])
def test_a_plane_is_dug_in_any_coordinates(soil):
    near, far = site_on(soilvdb.plane(0.0), soil), site_on(soilvdb.plane(0.0), soil)
    # As many metres as leave the samples where they are, so that all bits agree.
    shift = np.array([65536 * 0.1 * 80, 65536 * 0.1 * 800, 0])
    path = np.stack([np.linspace(0, 3, 40), np.zeros(40), 0.1 - 0.5 * np.linspace(0, 1, 40)], 1)
    a = near.update_path(0, positions=path)
    b = far.update_path(0, positions=path + shift)
    assert b["cut_m3"] == pytest.approx(a["cut_m3"], abs=1e-3)
    assert far.change_m3() == pytest.approx(near.change_m3(), rel=1e-4)
    points, _ = far.mesh()
    assert np.abs(points.mean(0) - shift).max() < 3
    other = site_on(soilvdb.plane(0.0), soil)
    other.restore(far.save())
    for again in (other, far.clone(), pickle.loads(pickle.dumps(far))):
        assert again.save() == far.save()
    with pytest.raises(soilvdb.StateError, match="within"):
        far.limits = False
        far.update(0, position=(0, 0, 0))


@pytest.mark.parametrize("seed", range(4))
def test_parts_sum_to_the_whole_whichever_way_their_edge_is_walked(seed):
    random = np.random.default_rng(seed)
    site = site_on(soilvdb.plane(0.0))
    for x in np.linspace(0, 4, 40):
        site.update(0, position=(x, 0, -0.3))
    sample = 0.1**3 / 64
    whole = site.volume([(-9, -9), (9, -9), (9, 9), (-9, 9)]).cut_m3
    for _ in range(40):
        a = random.integers(-400, 400, 2) / 10 - 0.0125 * random.integers(0, 8)
        b = a + random.integers(1, 900, 2) / 10 * (1, random.choice([-1, 1]))
        way = (b - a) / np.hypot(*(b - a))
        a, b, aside = a - 60 * way, b + 60 * way, 150 * np.array([-way[1], way[0]])
        left = site.volume([a, b, b + aside, a + aside]).cut_m3
        right = site.volume([b, a, a - aside, b - aside]).cut_m3
        assert (left + right - whole) / sample == pytest.approx(0, abs=1e-3)


def test_masked_heights_are_no_ground():
    heights = np.ma.masked_less(np.where(np.eye(10) > 0, -9999.0, 1.0), -100)
    site = site_on(soilvdb.raster(heights, origin=(0, 0), cell=1))
    assert np.isnan(site.heights([(3, 3)])[0])
    assert site.heights([(7, 1)])[0] == 1
    same = site_on(soilvdb.raster(heights.filled(-np.nan) + 0.0, origin=(0, 0), cell=1))
    same.restore(site.save())


def test_a_snapshot_never_replaces_another_terrain(tmp_path):
    low, high = (site_on(soilvdb.raster(np.full((9, 9), z), origin=(-4, -4), cell=1)) for z in (0.0, 1.0))
    low.write(tmp_path / "now.vdb")
    high.write(tmp_path / "later.vdb")
    high.write(tmp_path / "now.vdb")
    low.write(tmp_path / "again.vdb")
    for name, z in (("later", 1), ("now", 1), ("again", 0)):
        assert site_on(soilvdb.snapshot(tmp_path / f"{name}.vdb")).heights([(0, 0)])[0] == z
    files = sorted(p.name for p in tmp_path.iterdir())
    terrains = sorted(tmp_path.glob("terrain_*.tif"))
    terrains[0].write_bytes(terrains[1].read_bytes())
    terrains[1].write_bytes(b"no raster")
    low.write(tmp_path / "now.vdb")
    high.write(tmp_path / "later.vdb")
    for name, z in (("later", 1), ("now", 0), ("again", 0)):
        assert site_on(soilvdb.snapshot(tmp_path / f"{name}.vdb")).heights([(0, 0)])[0] == z
    with pytest.raises((RuntimeError, ValueError)):
        site_on(soilvdb.raster(np.full((9, 9), 2.0), origin=(-4, -4), cell=1)).write(
            tmp_path / "no" / "such.vdb")
    (tmp_path / "folder.vdb").mkdir()
    with pytest.raises((RuntimeError, ValueError)):
        site_on(soilvdb.raster(np.full((9, 9), 2.0), origin=(-4, -4), cell=1)).write(
            tmp_path / "folder.vdb")
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*files, "folder.vdb"])


def test_a_plane_has_no_place_until_a_machine_is_there(tmp_path):
    far = (5e5, 5e6, -0.2)
    makes = [lambda s: s, lambda s: pickle.loads(pickle.dumps(s)), lambda s: s.clone()]
    for make in makes:
        for before in (lambda s: None, lambda s: s.restore(s.save()), lambda s: s.come_to_rest(),
                       lambda s: s.reset_clock(0), lambda s: s.heights([(0, 0)])):
            site = make(site_on(soilvdb.plane(0.0)))
            before(site)
            site.update(0, position=far)
            assert site.change_m3() <= 0
    recorded = site_on(soilvdb.plane(0.0))
    recorded.record(tmp_path / "r")
    with pytest.raises(soilvdb.StateError, match="too far from a recorded site at 0, 0, 0; say near"):
        recorded.update(0, position=far)
    recorded.update(0, position=(0, 0, 0))
    near = site_on(soilvdb.plane(0.0), near=far)
    near.record(tmp_path / "n")
    near.update(0, position=far)


@pytest.mark.parametrize("posts", [5, 6, 30, 64, 66])
def test_rays_along_the_last_posts_meet_the_ground(posts):
    end = posts - 1
    site = site_on(soilvdb.raster(np.zeros((posts, posts)), origin=(0, 0), cell=1))
    slant = 2.2 / end
    far = 2 * np.hypot(1, slant) / slant
    for at, way in (((end, end, 2), (0, -1)), ((0, end, 2), (1, 0)), ((0, 0, 2), (1, 0)),
                    ((0, 0, 2), (0, 1)), ((end, end, 2), (-1, 0)), ((end, 0, 2), (0, 1))):
        assert site.cast(at, (*way, -slant)) == pytest.approx(far)


def test_volumes_inside_boundaries():
    site = site_on(soilvdb.plane(0.0), LOAM)
    for x in np.linspace(0, 2, 30):
        site.update(0, position=(x, 0, -0.3))
    site.update(0, position=(2, 0, 1.5))
    site.update(0, position=(6, 0, 1.5))
    site.update(0, position=(6, 0, 1.5), rotation=(0, np.sin(0.8), 0, np.cos(0.8)))
    site.come_to_rest()
    whole = site.volume([(-5, -5), (15, -5), (15, 5), (-5, 5)])
    books = site.ledger()
    assert whole.net_m3 == pytest.approx(site.change_m3(), abs=1e-9)
    assert whole.area_m2 == pytest.approx(200)
    assert whole.cut_m3 > 0.4 and whole.fill_m3 > 0.4
    assert whole.to_cut_m3 is None
    assert whole.fill_m3 <= books["fill_m3"] + 1e-9
    parts = [site.volume([(x0, -5), (x1, -5), (x1, 5), (x0, 5)]) for x0, x1 in ((-5, 1.23), (1.23, 15))]
    assert sum(p.net_m3 for p in parts) == pytest.approx(whole.net_m3, abs=1e-9)
    assert sum(p.cut_m3 for p in parts) == pytest.approx(whole.cut_m3, abs=1e-9)
    left = site.volume([(-5, -5), (15, -5), (15, 5), (-5, 5)], design=soilvdb.plane(-0.5))
    assert left.to_cut_m3 - left.to_fill_m3 == pytest.approx(100 + whole.net_m3, rel=2e-3)
    assert left.cut_m3 == whole.cut_m3
    copy = pickle.loads(pickle.dumps(left))
    assert (copy.to_cut_m3, copy.net_m3) == (left.to_cut_m3, left.net_m3)
    for boundary, message in [([(0, 0), (1, 1)], "3 corners"),
                              ([(0, 0), (1, 1), (1e160, 0)], "within 1e\\+09 m"),
                              ([(np.cos(a), np.sin(a)) for a in np.linspace(0, 6, 5000)], "3 to 4096"), ([(0, 0), (1, np.nan), (1, 1)], "corner 1"),
                              ([(0, 0), (1, 1), (1, 0), (0, 1)], "cross")]:
        with pytest.raises(ValueError, match=message):
            site.volume(boundary)
    on_an_island = site_on(soilvdb.raster(np.zeros((5, 5)), origin=(0, 0), cell=1))
    assert on_an_island.volume([(2, 2), (8, 2), (8, 3), (2, 3)]).area_m2 == pytest.approx(2, rel=0.02)
    around = on_an_island.volume([(-2e4, -2e4), (2e4, -2e4), (2e4, 2e4), (-2e4, 2e4)])
    assert around.area_m2 == pytest.approx(16)
    strip = site.volume([(0, 5), (1000, 1005), (1000, 1006), (0, 6)], design=soilvdb.plane(-1.0))
    assert strip.to_cut_m3 == pytest.approx(1000, rel=0.01) and strip.area_m2 == pytest.approx(1000)
    with pytest.raises(ValueError, match="finite"):
        site.volume([(0, 0), (1, 0), (1, 1)], design=soilvdb.plane(float("nan")))
    with pytest.raises(ValueError, match="no ground inside the boundary"):
        on_an_island.volume([(20, 20), (21, 20), (21, 21)])
    json.dumps([whole.cut_m3, whole.error_m3])


def triangles_of(path):
    """The triangles of a LandXML surface, (n, 3, 3): east, north, height."""
    root = ElementTree.parse(path).getroot()
    space = "{http://www.landxml.org/schema/LandXML-1.2}"
    assert root.tag == space + "LandXML"
    places = {p.get("id"): [float(v) for v in p.text.split()] for p in root.iter(space + "P")}
    faces = np.array([[places[i] for i in f.text.split()] for f in root.iter(space + "F")])
    return root.find(f"{space}CoordinateSystem"), faces[..., [1, 0, 2]]


def test_landxml_out_has_the_volume_of_the_ledger_and_is_terrain_again(tmp_path):
    soilvdb.write_raster(tmp_path / "plain.tif", np.full((30, 30), 5, np.float32), (500000.5, 5400000.5), (1, 1))
    subprocess.run(["gdal_translate", "-q", "-a_srs", "EPSG:25832", "plain.tif", "flat.tif"], cwd=tmp_path, check=True)
    site = site_on(soilvdb.raster(tmp_path / "flat.tif"))
    site.update_path(0, positions=[(500010 + 0.05 * i, 5400012 + 0.03 * i, 4.6) for i in range(100)])
    site.write(tmp_path / "now.vdb")
    for to, *more in (["now.xml"], ["part.xml", "--region", "500008,5400008,500018,5400018"]):
        subprocess.run([PROGRAM, "export", "now.vdb", "--to", to, *more], cwd=tmp_path, check=True,
                       stdout=subprocess.DEVNULL)
    crs, faces = triangles_of(tmp_path / "now.xml")
    assert crs.get("epsgCode") == "25832"
    a, b, c = (faces[:, k] - faces[0, 0] * (1, 1, 0) for k in range(3))
    areas = np.cross((b - a)[:, :2], (c - a)[:, :2]) / 2
    assert (areas > 0).all()
    below = (areas * (5 - faces[..., 2].mean(1))).sum()
    volume = site.volume([(500001, 5400001), (500029, 5400001), (500029, 5400029), (500001, 5400029)])
    assert volume.cut_m3 > 0.5
    # Coordinates have five decimals.
    assert below == pytest.approx(volume.cut_m3, abs=2 * areas.sum() * 1e-5)
    again = site_on(soilvdb.raster(tmp_path / "now.xml"))
    xy = np.random.default_rng(0).uniform((500010, 5400012), (500015, 5400015), (300, 2))
    inside = np.isfinite(again.heights(xy))
    assert inside.sum() > 200
    np.testing.assert_allclose(np.mean(again.heights(xy)[inside] - site.heights(xy)[inside]), 0, atol=0.01)
    told = subprocess.run([PROGRAM, "info", "part.xml"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert "surface of triangles, LandXML" in told and "EPSG:25832" in told


def test_a_snapshot_on_triangles_is_complete(tmp_path):
    def surface(name, top):
        points = "".join(f'<P id="{n}">{y} {x} {z}</P>' for n, (x, y, z) in enumerate(
            [(0, 0, top), (20, 0, top), (20, 20, top + 2), (0, 20, top + 2)]))
        return (f'<Surface name="{name}"><Definition surfType="TIN"><Pnts>{points}</Pnts>'
                "<Faces><F>0 1 2</F><F>0 2 3</F></Faces></Definition></Surface>")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "site.xml").write_text(
        '<LandXML version="1.2"><Units><Metric linearUnit="meter"/></Units><Surfaces>'
        + surface("now", 5) + surface("then", 1) + "</Surfaces></LandXML>")
    (tmp_path / "a" / "dig.csv").write_text("time,x,y,z,pitch\n0,8,10,6.4,0\n1,9,10,5.5,0\n3,12,10,5.5,0\n")
    (tmp_path / "a" / "dig.yaml").write_text(
        "soilvdb: 1\nvoxel_size: 0.1\nterrain: {raster: 'site.xml#now'}\n"
        "machines: [{name: d, bucket: {width: 1.2, height: 0.9}, motion: dig.csv}]\n")
    summary = soilvdb.run(tmp_path / "a" / "dig.yaml", out=tmp_path / "a" / "out")
    # 3.6 m2 of a mouth 1.2 m wide, 0.5 m below ground that rises along y by as much as it falls.
    assert summary["volume_m3"]["residual"] == 0 and 1.5 < summary["volume_m3"]["cut"] < 3
    (tmp_path / "a").rename(tmp_path / "b")
    later = site_on(soilvdb.snapshot(tmp_path / "b" / "out" / "soil_final.vdb"))
    assert later.heights([(4, 10), (10.5, 10)]) == pytest.approx([6, 5.5], abs=0.05)
    verified = subprocess.run([PROGRAM, "verify", "out"], cwd=tmp_path / "b", capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stderr
    other = site_on(soilvdb.raster(tmp_path / "b" / "site.xml#then"))
    assert other.heights([(10.5, 10)]) == pytest.approx([2], abs=0.01)
    with pytest.raises(ValueError, match="has 2 surfaces, 'now' and 'then'; name one, as in site.xml#now"):
        site_on(soilvdb.raster(tmp_path / "b" / "site.xml"))
