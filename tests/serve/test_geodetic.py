# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Machines placed by the latitudes, longitudes and heights of their antennas."""
import json
import math
import struct
import subprocess

import numpy as np
import pytest
from live import PROGRAM, Server
from test_feeds import DATA, START
from test_machines import digest, machines

VOXEL = 0.1
PROFILE = "[[0, 0], [-0.5, 0.1], [-0.6, 0.6], [0, 0.9]]"
ZONE = 9  # middle of UTM's zone 32, degrees
GEOID = 47.1
LEVERS = [[-1.2, 0.9, 2.8], [-1.2, -0.9, 2.8]]  # in the excavator's root
GNSS = f"{{antennas: {LEVERS}, site_crs: EPSG:32632, geoid: {GEOID}}}"


def utm(latitude, longitude):
    """By Krüger's series to the fourth power of the third flattening (Karney 2011, eq. 35)."""
    axis, f, scale = 6378137.0, 1 / 298.257223563, 0.9996
    n, e = f / (2 - f), math.sqrt(f * (2 - f))
    alpha = (n / 2 - 2 * n**2 / 3 + 5 * n**3 / 16 + 41 * n**4 / 180,
             13 * n**2 / 48 - 3 * n**3 / 5 + 557 * n**4 / 1440,
             61 * n**3 / 240 - 103 * n**4 / 140, 49561 * n**4 / 161280)
    sine, l = math.sin(math.radians(latitude)), math.radians(longitude - ZONE)
    t = math.sinh(math.atanh(sine) - e * math.atanh(e * sine))
    sphere = complex(math.atan2(t, math.cos(l)), math.asinh(math.sin(l) / math.hypot(t, math.cos(l))))
    place = sphere + sum(a * np.sin(2 * (j + 1) * sphere) for j, a in enumerate(alpha))
    radius = axis / (1 + n) * (1 + n**2 / 4 + n**4 / 64) * scale
    return np.array([500000 + radius * place.imag, radius * place.real])


def latitude_longitude(place):
    """The inverse, by Newton's method."""
    at, step = np.array([place[1] / 111000, ZONE + 0.1]), 1e-5
    for _ in range(20):
        slope = np.array([utm(*(at + d)) - utm(*(at - d)) for d in step * np.eye(2)]).T / (2 * step)
        at = at - np.linalg.solve(slope, utm(*at) - place)
    return at


SITE = np.round(utm(48.0, ZONE + 3.0))  # three degrees off the zone's middle


def rotation(roll, pitch, yaw):
    """Of URDF's angles, as a matrix."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array([[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
                     [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
                     [-sp, cp * sr, cp * cr]])


def quaternion(roll, pitch, yaw):
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.array([roll, pitch, yaw]) / 2), np.sin(np.array([roll, pitch, yaw]) / 2)
    return [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy]


def pose(position, rpy):
    return {"position": list(map(float, position)), "rotation": list(map(float, quaternion(*rpy)))}


def antennas(position, rpy, levers=LEVERS, geoid=GEOID):
    """What a receiver says of a frame there."""
    places = [np.array(position) + rotation(*rpy) @ lever for lever in np.array(levers)]
    found = [(latitude_longitude(place[:2]), place[2]) for place in places]
    return [{"lat": at[0], "lon": at[1], "height": z + geoid} for at, z in found]


def geodetic(position, rpy):
    return {"antennas": antennas(position, rpy), "roll": rpy[0], "pitch": rpy[1]}


def site(folder, gnss=GNSS, terrain="plane: {z: 0.0}", urdf=True, base=SITE):
    path = folder / "site.yaml"
    chain = f"""\
    urdf: {DATA / "excavator.urdf"}
    base: {{xyz: [{base[0]}, {base[1]}, 0.0]}}
    lip: {{link: bucket_link, xyz: [1.42, 0, 0], rpy: [3.141592653589793, 1.5, 0]}}
"""
    path.write_text(f"""\
soilvdb: 1
voxel_size: {VOXEL}
terrain: {{{terrain}}}
soil: {{repose_angle: 0.6, swell: 0.2}}
machines:
  - name: machine
    bucket: {{width: 1.2, height: 0.9, profile: {PROFILE}}}
{chain if urdf else ""}    gnss: {gnss}
""")
    return path


def level(folder, place, height):
    """A raster of 40 m x 40 m without a CRS."""
    west, south = np.round(place[:2]) - 20
    (folder / "level.asc").write_text(
        f"ncols 40\nnrows 40\nxllcorner {west}\nyllcorner {south}\ncellsize 1\n" + (f"{height} " * 40 + "\n") * 40)
    return folder / "level.asc"


def drive(count=50):
    """Places and angles of the root, and joints, of a drive with the bucket held low."""
    for i in range(count):
        joints = {**START, "boom_joint": 0.1 + 0.1 * math.sin(i / 9)}
        rpy = (0.03 * math.sin(i / 5), 0.02 * math.cos(i / 7), 0.4 + 0.01 * i)
        yield i, [SITE[0] - 0.1 * i, SITE[1] + 0.02 * i, 0.01 * math.sin(i)], rpy, joints


def test_it_leaves_the_ground_that_its_base_would(tmp_path):
    path = site(tmp_path)
    volumes, bases = [], []
    for how in ("base", "geodetic"):
        out = tmp_path / how
        with Server(path, "--out", out, cwd=tmp_path) as server:
            bases.append([])
            states = [{"machine": "machine", "time": 0.2 * i, "joints": joints,
                       how: pose(place, rpy) if how == "base" else geodetic(place, rpy)}
                      for i, place, rpy, joints in drive()]
            for state in states:
                answer, = server.feed([state])
                assert "error" not in answer, answer
                base = machines(server)["machine"]["state"]["base"]
                bases[-1].append([*base["position"], *base["rotation"]])
            volumes.append(server.json("/summary.json")["volume_m3"])
            last = machines(server)["machine"]["state"]
            again, = server.feed([last])
            assert again["cut_m3"] == 0, "what it says can be fed"
            last, ground = machines(server)["machine"]["state"], digest(server)  # a rotation is rounded
            server.stop()
        with Server(path, "--out", out, cwd=tmp_path) as server:  # the journal has the base
            assert machines(server)["machine"]["state"] == last and digest(server) == ground
    assert np.abs(np.subtract(*bases)).max() < 1e-4
    assert volumes[0]["cut"] > 0.2
    for key in ("cut", "fill", "ground_change"):
        assert volumes[1][key] == pytest.approx(volumes[0][key], rel=1e-3), key


def test_a_raster_tells_map_and_geoid(tmp_path):
    """Where NIMA published a height of EGM96; PROJ interpolates it linearly, within 0.07 m."""
    latitude, longitude, published = 46.8743190, 102.4487290, -43.575
    zone = 105 - ZONE  # of zone 48 beyond ours
    place = np.array([*utm(latitude, longitude - zone), 501.0])
    subprocess.run(["gdal_translate", "-q", "-a_srs", "EPSG:32648+5773", "-ot", "Float32",
                    level(tmp_path, place, 500), tmp_path / "level.tif"], check=True)
    both = antennas(place, (0, 0, 0.4), geoid=published)
    for one in both:
        one["lon"] += zone
    state = {"machine": "machine", "time": 0, "joints": START, "geodetic": {"antennas": both}}
    with Server(site(tmp_path, f"{{antennas: {LEVERS}}}", "raster: level.tif"), cwd=tmp_path) as server:
        answer, = server.feed([state])
        assert "error" not in answer, answer
        base = machines(server)["machine"]["state"]["base"]
        assert base["position"][:2] == pytest.approx(list(place[:2]), abs=1e-3)
        assert base["position"][2] == pytest.approx(place[2], abs=0.07)
        assert base["rotation"] == pytest.approx(quaternion(0, 0, 0.4), abs=1e-4)
    refused(site(tmp_path, GNSS, "raster: level.tif"), tmp_path,
            "'site_crs' is for a terrain without a CRS, and this one has WGS 84 / UTM zone 48N + EGM96 height")


def test_one_antenna_goes_with_a_rotation_and_a_blade_has_its_own(tmp_path):
    terrain = f"raster: {level(tmp_path, SITE, 0)}"
    path = site(tmp_path, f"{{antennas: [[0.5, 0.2, 2.0]], site_crs: EPSG:32632, geoid: {GEOID}}}", terrain, False)
    place, rpy = [*SITE, 0.6], (0.1, -0.2, 2.0)
    line = {"machine": "machine", "time": 0.0,
            "geodetic": {"antennas": antennas(place, rpy, [[0.5, 0.2, 2.0]]), "rotation": quaternion(*rpy)}}
    with Server(path, "--out", tmp_path / "one", cwd=tmp_path) as server:
        status, (answer,) = server.post("/feed", [line])
        assert status == 200, answer
        state = machines(server)["machine"]["state"]
        assert state["position"] == pytest.approx(place, abs=1e-4)
        assert state["rotation"] == pytest.approx(quaternion(*rpy), abs=1e-9)
        for change, why in (
                ({"rotation": None}, "'rotation' must be an array of 4 numbers"),
                ({"rotation": [0, 0, 0, 2]}, "'rotation' must be a unit quaternion x, y, z, w; its length is 2"),
                ({"roll": 0.1}, "one antenna goes with a 'rotation', x, y, z, w in the world"),
                ({"pitch": 0.1}, "one antenna goes with a 'rotation', x, y, z, w in the world")):
            answer, = server.feed([{**line, "geodetic": {**line["geodetic"], **change}}])
            assert answer["error"] == f"'geodetic': {why}"
        answer, = server.feed([{**line, "joints": START}])
        assert answer["error"] == "machine 'machine' has no joints; 'geodetic' is where its bucket is"
    masts = [[0.0, 1.5, 2.5], [0.0, -1.5, 2.5]]
    path = site(tmp_path, f"{{antennas: {masts}, site_crs: EPSG:32632, geoid: {GEOID}}}", terrain, False)
    rpy = (0.05, 0.0, -1.0)
    with Server(path, "--out", tmp_path / "two", cwd=tmp_path) as server:
        answer, = server.feed([{"machine": "machine", "geodetic": {"antennas": antennas(place, rpy, masts)}}])
        assert "error" not in answer
        state = machines(server)["machine"]["state"]
        assert state["position"] == pytest.approx(place, abs=1e-4)
        assert state["rotation"] == pytest.approx(quaternion(*rpy), abs=1e-5)


@pytest.mark.parametrize("fix", ["rtk_float", "single"])
def test_positions_that_are_no_fix_may_have_a_wrong_baseline_and_do_not_dig(tmp_path, fix):
    joints = {**START, "boom_joint": 0.1}

    def state(time_s, x, fix, wrong=0.0):
        both = antennas([SITE[0] + x, SITE[1], 0.0], (0, 0, 0))
        both[0]["height"] += wrong
        return {"machine": "machine", "time": time_s, "joints": joints, "geodetic": {"antennas": both}, "fix": fix}
    with Server(site(tmp_path), cwd=tmp_path) as server:
        first, bad, floating, back = server.feed([
            state(0, 0, "rtk_fixed"), state(10, -1, "rtk_fixed", 0.9), state(20, -1, fix, 0.9),
            state(30, -2, "rtk_fixed")])
        assert "error" not in first
        assert bad["error"] == ("'geodetic': the antennas are 2.012 m apart, and 1.800 m in the scenario; these must "
                                "agree to 0.1 m, or the position is no 'fix' of 'rtk_fixed'")
        assert floating["placed"] is False and floating["cut_m3"] == 0
        assert "error" not in back
        tilted = state(40, -2, fix)
        answer, = server.feed([{**tilted, "geodetic": {**tilted["geodetic"], "roll": 0.3}}])
        assert answer["placed"] is False and answer["cut_m3"] == 0, "nor agree with an inclinometer"
        assert machines(server)["machine"]["state"]["base"]["position"][0] == pytest.approx(SITE[0] - 2, abs=1e-4)


GOOD = {"antennas": antennas([*SITE, 0.0], (0, 0, 0))}


def changed(antenna, **keys):
    both = [dict(one) for one in GOOD["antennas"]]
    both[antenna].update(keys)
    return {"geodetic": {"antennas": both}}


@pytest.mark.parametrize("change, why", [
    ({"geodetic": 1}, "'geodetic': it must be an object with an array 'antennas'"),
    ({"geodetic": {"antennas": {}}}, "'geodetic': it must be an object with an array 'antennas'"),
    ({"geodetic": {"antennas": GOOD["antennas"][:1]}}, "'geodetic': 'antennas' has 1 places; the scenario has 2"),
    ({"geodetic": {**GOOD, "yaw": 1}}, "'geodetic': unknown key 'yaw'; there are 'antennas', 'rotation'"),
    ({"geodetic": {**GOOD, "rotation": [0, 0, 0, 1]}},
     "'geodetic': two antennas tell the rotation; 'roll' and 'pitch' may go with them"),
    ({"geodetic": {**GOOD, "roll": 12.5}},
     "'geodetic': 'roll' is 12.5; it must be in radians, within 0.8"),
    ({"geodetic": {**GOOD, "roll": 0.3}},
     "'geodetic': the line through the antennas rises by 0.000, and by -0.296 with 'roll' and 'pitch'; these must agree"),
    ({"geodetic": {"antennas": antennas([*SITE, 0.0], (0, 0, 0), [[-1.2, 0.75, 2.8], [-1.2, -0.75, 2.8]])}},
     "'geodetic': the antennas are 1.500 m apart, and 1.800 m in the scenario; these must agree to 0.1 m"),
    ({"geodetic": {"antennas": [GOOD["antennas"][0]] * 2}, "fix": "single"},
     "'geodetic': the antennas are at one place, and tell no heading"),
    ({"geodetic": {**GOOD, "pitch": "0"}}, "'geodetic': 'pitch' must be a number"),
    ({"geodetic": {"antennas": [1, 2]}}, "'geodetic': an antenna must be an object with 'lat', 'lon' and 'height'"),
    (changed(0, alt=3), "'geodetic': unknown key 'alt'; there are 'lat', 'lon' and 'height'"),
    (changed(0, height=None), "'geodetic': 'height' must be a number"),
    (changed(1, lat=91), "'geodetic': 'lat' is 91; it must be from -90 to 90 degrees"),
    (changed(1, lon=-180.5), "'geodetic': 'lon' is -180.5; it must be from -180 to below 360 degrees"),
    (changed(0, height=501000), "'geodetic': 'height' is 501000; it must be within 10000 m"),
    (changed(0, lat=0, lon=ZONE + 90), "'geodetic': PROJ can't transform latitude"),
    ({"geodetic": {"antennas": antennas([SITE[0] + 150, SITE[1], 0], (0, 0, 0))}},
     "machine 'machine': its base would move 150 m in one state"),
    ({"base": pose([*SITE, 0], (0, 0, 0))},
     "'geodetic' is in place of 'base', or of 'position' and 'rotation'; give one of them"),
    ({"joints": None}, "'joints' must be an object of numbers"),
    ({"fix": "good"}, "'fix' is 'good'; there are 'rtk_fixed', 'rtk_float' and 'single'"),
])
def test_positions_that_cant_be_are_refused_and_change_nothing(tmp_path, change, why):
    state = {"machine": "machine", "time": 0.0, "joints": START, "geodetic": GOOD}
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        first, = server.feed([state])
        assert "error" not in first, first
        before, there = digest(server), machines(server)["machine"]["state"]
        answer, = server.feed([{**state, "time": 5.0, **change}])
        assert why in answer["error"]
        answer, = server.feed([{"machine": "machine", "time": 5.0, "geodetic": GOOD}])
        assert answer["error"] == "'geodetic' is where the root of the urdf is; give 'joints', too"
        assert digest(server) == before and machines(server)["machine"]["state"] == there


def test_a_site_elsewhere_is_refused(tmp_path):
    far = antennas([SITE[0] - 200000, SITE[1] + 1000000, 0], (0, 0, 0))
    with Server(site(tmp_path), cwd=tmp_path) as server:
        answer, = server.feed([{"machine": "machine", "joints": START, "geodetic": {"antennas": far}}])
        assert "it must be within 838859 m of (720896, " in answer["error"]
        assert machines(server)["machine"]["state"] is None


def refused(path, folder, why):
    done = subprocess.run([PROGRAM, "serve", path, "--port", "0", "--out", folder / "refused"], cwd=folder, text=True,
                          capture_output=True, timeout=60, check=False)
    assert done.returncode == 2 and not (folder / "refused").exists()
    assert done.stderr.splitlines()[-1].startswith(f"soilvdb: {path}: machine 'machine': gnss: {why}"), done.stderr


@pytest.mark.parametrize("gnss, why", [
    ("geoid: 0", "the terrain has no CRS, in which the positions would be; give 'site_crs'"),
    ("site_crs: EPSG:32632", "the site's CRS, EPSG:32632, doesn't tell what its heights are above; give 'geoid'"),
    ("site_crs: EPSG:32632+7837", "PROJ lacks the grid "),
    ("site_crs: EPSG:32632, geoid: none.gtx", "'geoid' is 'none.gtx', no grid that PROJ can read"),
    ("site_crs: EPSG:4326, geoid: 0", "the site's CRS, EPSG:4326, must be a map's with x east, y north"),
])
def test_a_site_whose_positions_cant_be_known_does_not_begin(tmp_path, gnss, why):
    refused(site(tmp_path, f"{{antennas: {LEVERS}, {gnss}}}"), tmp_path, why)


def test_a_receivers_crs_that_is_hardly_the_sites_is_warned_of(tmp_path):
    with Server(site(tmp_path, f"{{antennas: {LEVERS}, site_crs: EPSG:25832, geoid: 0}}"), cwd=tmp_path) as server:
        assert ("warning: machine 'machine': the way from EPSG:4979 to EPSG:25832 is known to 1 m; 'crs' should be "
                "that of the receiver's corrections\n") in server.stop()


def test_a_machine_with_a_receiver_may_come_to_a_running_site(tmp_path):
    path = site(tmp_path)

    def comer(name, **gnss):
        return json.dumps({"add": {"name": name, "bucket": {"width": 2.0, "height": 1.0},
                                   "gnss": {"antennas": [[0, 1, 2], [0, -1, 2]], **gnss}}})
    place = [SITE[0] + 30, SITE[1], 1.5]
    line = {"machine": "dozer", "geodetic": {"antennas": antennas(place, (0, 0, 1), [[0, 1, 2], [0, -1, 2]])}}
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        status, body = server.get("/machines", method="POST", data=comer("other", geoid=0).encode())
        assert status == 400 and b"gnss: the terrain has no CRS" in body
        status, body = server.get("/machines", method="POST",
                                  data=comer("dozer", site_crs="EPSG:32632", geoid=GEOID).encode())
        assert status == 200, body
        assert "error" not in server.feed([line])[0]
        state = machines(server)["dozer"]["state"]
        assert state["position"] == pytest.approx(place, abs=1e-4)
        server.stop()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert machines(server)["dozer"]["state"] == state
        assert server.feed([line])[0]["cut_m3"] == 0


def test_a_recording_needs_no_grids(tmp_path):
    grid = tmp_path / "local.gtx"
    grid.write_bytes(struct.pack(">4d2i", 47, 8, 1, 1, 3, 8) + struct.pack(">24f", *[GEOID] * 24))
    add = {"name": "dozer", "bucket": {"width": 2.0, "height": 1.0},
           "gnss": {"antennas": [[0, 1, 2], [0, -1, 2]], "site_crs": "EPSG:32632", "geoid": "local.gtx"}}
    place = [SITE[0] + 30, SITE[1], 1.5]
    line = {"machine": "dozer", "geodetic": {"antennas": antennas(place, (0, 0, 1), [[0, 1, 2], [0, -1, 2]])}}
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        status, body = server.get("/machines", method="POST", data=json.dumps({"add": add}).encode())
        assert status == 200, body
        assert "error" not in server.feed([line])[0]
        state = machines(server)["dozer"]["state"]
        assert state["position"] == pytest.approx(place, abs=1e-4)
        server.stop()
    grid.unlink()
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert machines(server)["dozer"]["state"] == state
        assert "local.gtx" in server.feed([line])[0]["error"]


def test_a_machine_without_a_receiver_has_no_antennas(tmp_path):
    path = site(tmp_path)
    path.write_text(path.read_text().replace(f"    gnss: {GNSS}\n", ""))
    with Server(path, cwd=tmp_path) as server:
        answer, = server.feed([{"machine": "machine", "joints": START, "geodetic": GOOD}])
        assert answer["error"] == ("machine 'machine' has no 'gnss' in the scenario, the places of its antennas; give "
                                   "it that, or leave 'geodetic' out")
