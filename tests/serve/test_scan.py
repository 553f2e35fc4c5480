# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Scans that correct the ground of a live site: what they find, what is kept of them, what is refused."""
import asyncio
import functools
import json
import math
import struct
import time

import numpy as np
import pytest
import soilvdb
from live import Server, passes, view
from osgeo import gdal
from test_disk import fill, small_disk
from test_feeds import DATA, START

VOXEL, CELL = 0.1, 0.01
PROFILE = [[0, 0], [-0.45, -0.1], [-0.85, 0.15], [-0.95, 0.55], [-0.7, 0.9], [0, 0.9]]
EYE, DOWN = (0.45, 0.45, 4.0), (1.0, 0.0, 0.0, 0.0)
SHAPE, INTRINSICS = (360, 480), (256.0, 256.0, 240.0, 180.0)
SITE = f"""\
soilvdb: 1
voxel_size: {VOXEL}
terrain: {{plane: {{z: 0.0}}}}
machines:
  - name: digger
    bucket: {{width: 1.2, height: 0.9, profile: {PROFILE}}}
  - name: plate
    bucket: {{width: 1.0, height: 0.6}}
sensors:
  mast: {{at: {list(EYE)}, rotation: {list(DOWN)}, noise: {{range: 0.005}}}}
  bucket: {{machine: digger, at: [0.45, 5.45, 1.0], rotation: {list(DOWN)}, noise: {{range: 0.005}}}}
  flying: {{noise: ouster_os1}}
"""
DEPTH = {"sensor": "mast", "format": "depth_float32", "shape": SHAPE, "intrinsics": INTRINSICS}
POINTS = {"sensor": "mast", "format": "float32_xyz"}
CLOUD = {"sensor": "mast", "format": "cdr", "type": "sensor_msgs/msg/PointCloud2"}
# Out of the picture, and far from the pit.
PARKED = {"machine": "digger", "time": 1.0, "position": [0.0, -5.0, 3.0], "rotation": [0, 0, 0, 1]}


def site(folder, more="soil: {repose_angle: 0.6, swell: 0.2}\n"):
    path = folder / "site.yaml"
    path.write_text(SITE + more)
    return path


def excavator_site(folder, more="soil: {repose_angle: 0.6, swell: 0.2}\n"):
    """Level ground, and the machine of the demonstrations with this module's bucket."""
    path = folder / "site.yaml"
    path.write_text(f"""\
soilvdb: 1
voxel_size: {VOXEL}
terrain: {{plane: {{z: 0.0}}}}
machines:
  - name: excavator
    bucket: {{width: 1.2, height: 0.9, profile: {PROFILE}}}
    urdf: {DATA / "excavator.urdf"}
    base: {{xyz: [0.0, -4.0, 0.0], rpy: [0, 0, 0]}}
    lip: {{link: bucket_link, xyz: [1.42, 0, 0], rpy: [3.141592653589793, 1.5, 0]}}
{more}""")
    return path


def cab_sensor(base, angle):
    """A sensor on that machine's cab, at EYE and DOWN when the cab is turned by `angle` in all."""
    x, y, z = np.array(EYE) - base - [0, 0, 1.05]  # from the cab's joint
    place = [math.cos(angle) * x + math.sin(angle) * y, -math.sin(angle) * x + math.cos(angle) * y, z]
    turn = [math.cos(angle / 2), -math.sin(angle / 2), 0.0, 0.0]
    return ("sensors:\n"
            f"  cab: {{machine: excavator, link: cab_link, at: {place}, rotation: {turn}, noise: {{range: 0.005}}}}\n")


def message(head, points=b""):
    head = head if isinstance(head, bytes) else json.dumps(head).encode()
    return struct.pack("<I", len(head)) + head + points


def scan(server, messages, path="/scan"):
    """Sends messages one after another through one connection; the answers."""
    async def work():
        answers = []
        async with server.connect(path) as stream:
            for one in messages:
                await stream.send(one)
                answers.append(json.loads(await stream.recv()))
        return answers
    return asyncio.run(work())


@functools.cache
def pit(depth=0.5):
    """What a camera above level ground sees of a pit of 10 x 10 columns, and its volume. Each post of
    the terrain has its cell, and the pit ends where columns do."""
    first, count = round((4 - VOXEL / 2) / CELL), round(10 * VOXEL / CELL)
    posts = np.zeros((801, 801), np.float32)
    posts[first:first + count, first:first + count] = -depth
    truth = soilvdb.Site(CELL, soilvdb.raster(posts, origin=(CELL / 2 - 4, CELL / 2 - 4), cell=CELL),
                         [soilvdb.Bucket(1.0, 0.6)])
    camera = soilvdb.Sensor(name="mast", position=EYE, rotation=DOWN, range_sigma=0.005)
    image = soilvdb.depth_image(truth, camera, SHAPE, INTRINSICS)
    return image.astype("<f4"), depth * (count * CELL)**2


def points_of(image):
    """In the frame of the camera. Exact in float32 if depths are multiples of 2^-9 m."""
    fx, fy, cx, cy = INTRINSICS
    u, v = np.meshgrid(np.arange(image.shape[1]) - cx, np.arange(image.shape[0]) - cy)
    z = image.astype(float)
    return np.stack([u / fx * z, v / fy * z, z], axis=-1).reshape(-1, 3)


def cloud2(points, kind="<f4", fields=b"xyz", step=None):
    """sensor_msgs/PointCloud2 in CDR, little-endian, of float32 or float64."""
    size = np.dtype(kind).itemsize
    step = step or 4 * size  # some bytes more than three numbers have
    out = bytearray()

    def put(form, value):
        out.extend(bytes(-len(out) % struct.calcsize(form)) + struct.pack("<" + form, value))

    def text(value):
        put("I", len(value) + 1)
        out.extend(value + b"\0")
    put("i", 7)   # stamp
    put("I", 0)
    text(b"lidar")
    put("I", 1)
    put("I", len(points))
    put("I", len(fields))
    for k, name in enumerate(fields):
        text(bytes([name]))
        put("I", k * size)
        put("B", 7 if size == 4 else 8)
        put("I", 1)
    put("B", 0)
    put("I", step)
    put("I", step * len(points))
    rows = np.zeros((len(points), step), np.uint8)
    numbers = np.ascontiguousarray(points, dtype=kind).view(np.uint8).reshape(-1, 3 * size)
    rows[:, :3 * size] = numbers[:, :step]
    put("I", rows.size)
    out.extend(rows.tobytes())
    put("B", 0)
    return b"\0\1\0\0" + bytes(out)


def bands(server, folder):
    """Those of /surface.tif by their names."""
    (folder / "surface.tif").write_bytes(server.get("/surface.tif")[1])
    data = gdal.Open(str(folder / "surface.tif"))
    found = [data.GetRasterBand(n + 1) for n in range(data.RasterCount)]
    return {band.GetDescription(): band.ReadAsArray() for band in found}


def ground(server, query=""):
    summary = server.json("/summary.json" + query)
    return summary["state_hash"], summary["volume_m3"], summary.get("mass_kg")


def test_soil_that_was_taken_behind_the_servers_back_is_found(tmp_path):
    image, volume = pit()
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert all("error" not in answer for answer in server.feed(
            [*({**state, "position": [*np.add(state["position"], (0, -6, 0))]} for state in
               passes("digger", 0.0, 0.2, 20)), PARKED]))
        before = server.json("/summary.json")
        assert "surveyed_removed" not in before["volume_m3"]
        assert list(bands(server, tmp_path)) == ["surface", "change"]
        answer, = scan(server, [message({**DEPTH, "time": 1.5}, image.tobytes())])
        assert list(answer) == ["time", "acknowledged_s", "removed_m3", "added_m3", "sigma_m3", "rays", "lip_error"]
        assert answer["removed_m3"] == pytest.approx(volume, rel=0.005)
        assert answer["added_m3"] < 0.005 * volume and 0 < answer["sigma_m3"] < 0.1 * volume
        assert answer["time"] == 1.5 and answer["acknowledged_s"] == 1.0
        assert list(answer["rays"]) == ["used", "masked", "through", "new", "dropped", "far"]
        assert sum(answer["rays"].values()) <= image.size and answer["rays"]["through"] > 100
        assert set(answer["lip_error"]) == {"digger", "plate"}
        assert server.json("/height?x=0.5&y=0.5")["height_m"] == pytest.approx(-0.5, abs=0.005)
        after = server.json("/summary.json")
        assert after["volume_m3"]["surveyed_removed"] == answer["removed_m3"]
        assert after["volume_m3"]["surveyed_added"] == answer["added_m3"]
        assert after["volume_m3"]["residual"] == after["mass_kg"]["residual"] == 0
        assert after["mass_kg"]["surveyed"] < 0
        raster = bands(server, tmp_path)
        assert list(raster) == ["surface", "change", "sigma", "surveyed"]
        in_pit = raster["change"] < -0.45   # cells lie half-way between columns
        assert in_pit.sum() == 9 * 9 and np.all(raster["surveyed"][in_pit] == 1)
        assert 0 < raster["sigma"][in_pit].max() < 0.03
        dug = (raster["change"] < 0) & (raster["change"] > -0.45)   # out of the picture
        assert np.median(raster["surveyed"][dug]) == 0 and np.median(raster["sigma"][dug]) > 0.02
        assert after["volume_m3"]["cut"] == before["volume_m3"]["cut"], "no machine cut it"
        assert after["mass_kg"]["buckets"] == before["mass_kg"]["buckets"]
        mean, sigma = answer["lip_error"]["digger"]
        assert after["machines"][0]["lip_error_m"] == {"mean": mean, "sigma": sigma}
        texts, _ = asyncio.run(view(server, lambda texts, _: any(text["type"] == "state" for text in texts)))
        state = next(text for text in texts if text["type"] == "state")
        assert state["change_m3"] == pytest.approx(after["volume_m3"]["ground_change"], abs=1e-9)
        empty, = scan(server, [message(POINTS)])
        assert empty["removed_m3"] == empty["added_m3"] == 0 and empty["time"] is None


def test_all_formats_of_a_scan_give_the_same_ground(tmp_path):
    image, _ = pit()
    image = (np.round(image * 512) / 512).astype("<f4")  # numbers that float32 has
    image[:3] = np.nan
    image[3:6] = 0
    points = points_of(image)
    turned = points * (1, -1, -1) + EYE
    forms = {
        "depth": message(DEPTH, image.tobytes()),
        "float32": message(POINTS, points.astype("<f4").tobytes()),
        "float64": message({**POINTS, "format": "float64_xyz", "frame": "sensor"}, points.astype("<f8").tobytes()),
        "cdr": message(CLOUD, cloud2(points)),
        "cdr of doubles": message(CLOUD, cloud2(points, "<f8")),
        "own": message({**DEPTH, "position": EYE, "rotation": DOWN, "noise": {"range": 0.005}}, image.tobytes()),
        "world": message({**POINTS, "format": "float64_xyz", "frame": "world"},
                         turned[points[:, 2] > 0].astype("<f8").tobytes())}
    grounds = {}
    for name, one in forms.items():
        with Server(site(tmp_path), "--out", tmp_path / name, cwd=tmp_path) as server:
            answer, = scan(server, [one])
            assert "error" not in answer, (name, answer)
            grounds[name] = ground(server)
    for name, of in grounds.items():
        assert of == grounds["depth"], name
    engine = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE), soilvdb.Bucket(1.0, 0.6)],
                          soil=soilvdb.Soil(repose_angle=0.6, swell=0.2))
    engine.scan(soilvdb.Sensor(name="mast", position=EYE, rotation=DOWN, range_sigma=0.005), depth=image,
                intrinsics=INTRINSICS)
    survey = engine.apply_scans()
    assert survey.removed_m3 == pytest.approx(grounds["depth"][1]["surveyed_removed"], abs=1e-9)


def test_a_sensor_is_where_its_machine_was(tmp_path):
    """The camera sees the pit from above at 1 s only; the machine has gone on since."""
    image, volume = pit()
    at = {"machine": "digger", "rotation": [0, 0, 0, 1]}
    states = [{**at, "time": 0.0, "position": [2.0, -5.0, 3.0]}, {**at, "time": 1.0, "position": [0.0, -5.0, 3.0]},
              {**at, "time": 2.0, "position": [0.0, -9.0, 3.0]}]
    head = {**DEPTH, "sensor": "bucket"}
    path = site(tmp_path)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        early, = scan(server, [message({**head, "time": 1.0}, image.tobytes())])
        assert "'digger', which carries the sensor, has no state yet" in early["error"]
        server.feed(states)
        early, = scan(server, [message({**head, "time": -1.0}, image.tobytes())])
        assert "'time' is -1 s, and where 'digger' was, which carries the sensor, is known from 0 s on" in early["error"]
        server.kill()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        if server.json("/summary.json")["updates"] < 3:  # the last second need not be on disk
            server.feed(states[server.json("/summary.json")["updates"]:])
        answer, = scan(server, [message({**head, "time": 1.9}, image.tobytes())])
        assert answer["removed_m3"] == pytest.approx(volume, rel=0.005) and "warning" not in answer
        again, = scan(server, [message({**head, "time": 1.0}, image.tobytes())])
        assert again["removed_m3"] + again["added_m3"] < 0.005 * volume
        assert "warning" not in again, "the machine was there at its last state before 1.9 s"
        moved = "scans: sensor 'bucket' has moved, and each of its poses is believed"
        once, never = scan(server, [message({**head, "time": 2.0}, image.tobytes())] * 2)
        assert moved in once["warning"] and moved not in never.get("warning", "")
        old, = scan(server, [message({**DEPTH, "time": -8.1}, image.tobytes())])
        assert "more than 10 s before the latest state, 2 s" in old["error"]
        ahead, = scan(server, [message({**DEPTH, "time": 62.1}, image.tobytes())])
        assert "more than 60 s after the latest state, 2 s; is the sensor's clock right?" in ahead["error"]
        reset, = server.feed([{"machine": "digger", "clock": "reset"}])
        assert "error" not in reset
        any_time, = scan(server, [message({**POINTS, "sensor": "bucket", "time": -50.0})])
        assert "error" not in any_time, "the times before count no more"


def test_a_sensor_on_a_link_moves_with_its_joints(tmp_path):
    image, volume = pit()
    swing = 0.7
    path = excavator_site(tmp_path, cab_sensor([0.0, -4.0, 0.0], swing))
    # The bucket stays out of the pit, and out of the picture.
    stretched = {**START, "boom_joint": 1.0, "arm_joint": -0.6}
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = server.feed([{"machine": "excavator", "time": 10 * t, "joints": {**stretched, "swing_joint": angle}}
                               for t, angle in enumerate((-1.0, swing, 2.5))])
        assert all("error" not in answer for answer in answers), answers
        head = {**DEPTH, "sensor": "cab"}
        answer, = scan(server, [message({**head, "time": 19.9}, image.tobytes())])
        assert "error" not in answer, answer
        assert answer["removed_m3"] == pytest.approx(volume, rel=0.005)
        server.feed([{"machine": "excavator", "time": 21, "position": [0, -9, 4], "rotation": [0, 0, 0, 1]}])
        answer, = scan(server, [message(head, image.tobytes())])
        assert "feed its 'joints'" in answer["error"]


def test_who_may_feed_may_scan_and_who_looks_may_not(tmp_path):
    image, _ = pit()
    (tmp_path / "feeds").write_text("d1g\n")
    (tmp_path / "looks").write_text("l00k\n")

    def status(client, path):
        try:
            return scan(client, [message(DEPTH, image.tobytes())], path)[0]
        except Exception as error:  # the library's classes differ by version
            return next(int(word.strip(".")) for word in str(error).split() if word.strip(".").isdigit())
    with Server(site(tmp_path), "--token-file", "feeds", "--view-token-file", "looks", "--out", tmp_path / "out",
                cwd=tmp_path) as server:
        assert status(server, "/scan") == 401
        assert status(server, "/scan?token=l00k") == 403
        assert status(server, "/scan?token=d1g")["removed_m3"] > 0
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        assert "can only be viewed" in status(server, "/scan")["error"]
        assert server.json("/summary.json")["volume_m3"]["surveyed_removed"] > 0


FLAT = np.full(SHAPE, 4.0, "<f4").tobytes()
THREE = np.array([(0, 0, 4), (0.1, 0, 4), (0.2, 0, 4)], "<f4")
OWN = {"format": "float32_xyz", "position": EYE, "rotation": DOWN}
BAD = [
    (b"", "message: it has 0 bytes; it must have 4 bytes with the length of its header"),
    (b"\1\0", "message: it has 2 bytes"),
    (struct.pack("<I", 1 << 20) + b"{}", "its header has 1048576 bytes, and may have 16384"),
    (struct.pack("<I", 0xffffffff) + b"{}", "its header has 4294967295 bytes, and may have 16384"),
    (struct.pack("<I", 100) + b"{}", "its header has 100 bytes, and 2 follow"),
    (message(b"{" + b" " * 16384 + b"}"), "its header has 16386 bytes, and may have 16384"),
    (message(b""), "header: not a JSON object"),
    (message(b"[1, 2]"), "header: not a JSON object"),
    (message(b"[" * 16000), "header: not a JSON object"),
    (message(b'{"sensor": "m\xffst"}'), "header: it is not UTF-8"),
    (message(b'{"sensor": "mast", "format": "float32_xyz", "time": NaN}'), "JSON has no NaN"),
    (message(b'{"sensor": "mast", "format": "float32_xyz", "time": 1e999}'), "header: not a JSON object"),
    (message({**POINTS, "time": "now"}), "header: 'time' must be a number"),
    (message({**POINTS, "time": 1e12}), "are these milliseconds?"),
    (message({**POINTS, "colour": 1}), "header: unknown key 'colour'; there are 'sensor'"),
    (message({"format": "float32_xyz"}), "header: 'sensor' is missing; name one of the scenario's 'sensors': "
     "'bucket', 'flying' and 'mast', or give 'position' and 'rotation'"),
    (message({**POINTS, "sensor": "msat"}), "header: there is no sensor 'msat'"),
    (message({**POINTS, "sensor": 7}), "header: 'sensor' must be a text"),
    (message({**POINTS, "sensor": "flying"}), "sensor 'flying' has no place in the scenario; give 'position'"),
    (message({**OWN, "sensor": "x" * 101}), "'sensor' has 101 bytes, and may have 100"),
    (message({"sensor": "mast"}), "header: 'format' is missing; there are float32_xyz, float64_xyz, depth_float32 and cdr"),
    (message({**POINTS, "format": "xyz"}), "header: 'format' is 'xyz'; there are"),
    (message({**POINTS, "frame": "map"}), "header: 'frame' must be \"world\" or \"sensor\""),
    (message({**POINTS, "shape": SHAPE}), "header: 'shape' goes with the format depth_float32 only"),
    (message({**POINTS, "position": EYE}), "header: 'position' and 'rotation' come together"),
    (message({**OWN, "rotation": [0, 0, 0, 2]}), "header: 'rotation' must be a unit quaternion"),
    (message({**OWN, "position": [0, 0]}), "header: 'position' must be an array of 3 numbers"),
    (message({**OWN, "position": [1e300, 0, 0]}), "header: "),
    (message({**OWN, "noise": "lidar9"}), "header: "),
    (message({**OWN, "max_range": 0}), "header: max_range is 0; it must be more than 0 and at most 1000"),
    (message({**OWN, "max_range": "9"}), "header: 'max_range' must be a number"),
    (message({**OWN, "noise": {"range": 0}}), "header: 'noise' has neither range nor range_squared"),
    (message({**OWN, "noise": {"range": -1}}), "header: 'range' is -1; it must be 0 to 10"),
    (message({**OWN, "mount": {"height": 11}}), "header: 'height' is 11; it must be 0 to 10"),
    (message({**OWN, "mount": 3}), "header: 'mount' must be"),
    (message({**OWN, "pose": {"turn": 11}}), "header: 'turn' is 11; it must be 0 to 10"),
    (message({**OWN, "pose": {"shift": -1}}), "header: 'shift' is -1; it must be 0 to 10"),
    (message({**OWN, "pose": {"tilt": 1}}), "header: unknown key 'tilt'; there are 'shift'"),
    (message({**OWN, "pose": [0, 0, 0]}), "header: 'pose' must be {\"shift\": m, \"turn\": rad}"),
    (message(POINTS, b"1234567"), "points: 7 bytes follow the header, which are no whole number of points of 12 bytes"),
    (message({**POINTS, "format": "float64_xyz"}, THREE.tobytes()), "of 24 bytes"),
    (message(POINTS, bytes(12 * ((1 << 20) + 1))), "points: there are 1048577, and may be 1048576"),
    (message(POINTS, np.full((3, 3), np.nan, "<f4").tobytes()), "points: none of 3 has a return"),
    (message(POINTS, (THREE * 1000).tobytes()), "points: one at (0, 0, 4000) is 4000 m from the sensor; it must be within 1000 m"),
    (message(POINTS, (THREE * 1e30).tobytes()), "points: point 0 is at"),
    (message({**POINTS, "frame": "world"}, (THREE + 5000).tobytes()), "m from the sensor"),
    (message({**DEPTH, "frame": "world"}, FLAT), "header: a depth image is in the sensor's frame"),
    (message({**DEPTH, "shape": [360, 480.5]}, FLAT), "header: 'shape' must be whole numbers"),
    (message({**DEPTH, "shape": [0, 480]}, FLAT), "header: 'shape' must be whole numbers"),
    (message({**DEPTH, "shape": [1 << 20, 1 << 20]}, FLAT), "header: 'shape' is 1048576 x 1048576 pixels"),
    (message({**DEPTH, "shape": [480]}, FLAT), "header: 'shape' must be an array of 2 numbers"),
    (message({**DEPTH, "intrinsics": [0, 256, 240, 180]}, FLAT), "header: 'intrinsics' must be [fx, fy, cx, cy]"),
    (message({"sensor": "mast", "format": "depth_float32"}, FLAT), "header: a depth image needs 'shape'"),
    (message(DEPTH, FLAT[:-4]), "points: 691196 bytes follow the header; 360 x 480 depths of 4 bytes are 691200"),
    (message(DEPTH, np.full(SHAPE, 4000, "<f4").tobytes()), "points: pixel (0, 0) has the depth 4000; depths must be in metres"),
    (message({**CLOUD, "type": "sensor_msgs/msg/Image"}, b""), "header: 'format' is 'cdr', so 'type' must be"),
    (message({**POINTS, "format": "cdr"}, b""), "header: 'format' is 'cdr', so 'type' must be"),
    (message(CLOUD, b""), "points: they are not a sensor_msgs/msg/PointCloud2 in CDR: it has no head of four bytes"),
    (message(CLOUD, cloud2(THREE)[:-10]), "points: they are not a sensor_msgs/msg/PointCloud2 in CDR: it ends within a field"),
    (message(CLOUD, cloud2(THREE, fields=b"xyi")), "points: the sensor_msgs/msg/PointCloud2 has no field 'z'"),
    (message(CLOUD, cloud2(THREE)[:60]), "in CDR: it is shorter than a list in it"),
    (message(CLOUD, cloud2(THREE, step=8)), "has the field 'z' at byte 8 of points of 8 bytes"),
    (message(CLOUD, cloud2(np.zeros((3, 3)))), "points: none of 3 has a return"),
    ("{}", "message: it is a text; scans are binary messages"),
    (bytes(33 << 20), "message: it has 34603008 bytes, and may have 33554432"),
]


def test_bad_messages_are_refused_and_change_nothing(tmp_path):
    image, _ = pit()
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed([PARKED])
        scan(server, [message(DEPTH, image.tobytes())])
        before = ground(server)
        answers = scan(server, [one for one, _ in BAD] + [message(POINTS)])
        for answer, (_, why) in zip(answers, BAD):
            assert list(answer) == ["error"] and why in answer["error"] and "\n" not in answer["error"], (why, answer)
        assert answers[-1]["removed_m3"] == answers[-1]["added_m3"] == 0, "the connection has stayed"
        assert ground(server) == before
        # A sensor keeps its noise, and does not change its name with each scan.
        other, = scan(server, [message({**POINTS, "noise": {"range": 0.1}}, THREE.tobytes())])
        assert "sensor 'mast' had other sigmas before" in other["error"]
        far, = scan(server, [message({**POINTS, "max_range": 2}, (THREE * 1000).tobytes())])
        assert far["rays"]["far"] == 3 and "beyond their sensor's max_range" in far["warning"]
        names = [message({**OWN, "sensor": f"camera {i}"}) for i in range(32)]
        answers = scan(server, names)
        assert all("error" not in answer for answer in answers[:31])
        assert "there were 32 others; give a sensor one name" in answers[31]["error"]
        assert ground(server) == before


@pytest.mark.parametrize("snapshots", ["", "output: {snapshots: {every: 0.5, incremental: true}}\n"])
def test_a_correction_that_was_answered_survives_a_kill(tmp_path, snapshots):
    image, volume = pit()
    path, out = site(tmp_path, "soil: {repose_angle: 0.6, swell: 0.2}\n" + snapshots), tmp_path / "out"
    away = {"machine": "plate", "position": [0, 9, 3], "rotation": [0, 0, 0, 1]}
    with Server(path, "--out", out, cwd=tmp_path) as server:
        server.feed([{**state, "position": [*np.add(state["position"], (0, -6, 0))]}
                     for state in passes("digger", 0.0, 0.2, 20)] + [PARKED])
        dug = ground(server)
        answer, = scan(server, [message(DEPTH, image.tobytes())])
        at_once = ground(server)
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert ground(server) == at_once
        server.feed([{**away, "time": 3.0}])
        filled, = scan(server, [message(DEPTH, FLAT)])
        assert filled["added_m3"] == pytest.approx(volume, rel=0.005)
        server.feed([{**away, "time": 4.0}])
        last = ground(server)
        # Other times have the ground as it was known then.
        assert ground(server, "?time=0.5")[1].get("surveyed_removed") is None
        assert ground(server, "?time=2.0") == at_once and at_once != dug
        assert ground(server, "?time=3.5")[1]["surveyed_added"] == pytest.approx(filled["added_m3"])
        assert server.json("/height?x=0.5&y=0.5&time=2.0")["height_m"] == pytest.approx(-0.5, abs=0.01)
        assert server.json("/volume?boundary=-1,-1,2,-1,2,2,-1,2&time=2.0")["cut_m3"] == pytest.approx(volume, rel=0.005)
        # What scans found can't be made anew, so states before them are not taken back.
        for method in ("GET", "POST"):
            status, body = server.get("/undo?machine=digger&time=0.1", method=method)
            assert status == 400 and "scans corrected the ground since that time" in json.loads(body)["error"]
        status, body = server.get("/undo?machine=plate&time=3.5", method="POST")
        assert status == 200 and json.loads(body)["states"] == 1
        assert ground(server) == last
        again, = scan(server, [message(DEPTH, image.tobytes())])
        assert again["removed_m3"] == pytest.approx(volume, rel=0.005)
        last = ground(server)
        assert last[1]["residual"] == last[2]["residual"] == 0
        server.stop()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert ground(server) == last
    with Server(out, cwd=tmp_path) as server:
        assert ground(server) == last


def test_feeds_scans_and_newcomers_go_on_beside_each_other(tmp_path):
    image, volume = pit()
    one = message({**DEPTH, "position": EYE, "rotation": DOWN}, image.tobytes())
    path, out = site(tmp_path), tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        async def work():
            async with server.connect("/scan") as first, server.connect("/scan") as second, server.connect("/feed") as feed:
                await first.send(one)
                await second.send(one)
                for i in range(50):
                    await feed.send(json.dumps({**PARKED, "time": 1 + 0.01 * i}))
                    assert "error" not in json.loads(await feed.recv())
                return [json.loads(await stream.recv()) for stream in (first, second)]
        answers = asyncio.run(work())
        assert sum(answer["removed_m3"] for answer in answers) == pytest.approx(volume, rel=0.005)
        status, _ = server.post("/machines", json.dumps({"add": {"name": "third", "bucket": {"width": 1.0, "height": 0.5}}}))
        assert status == 200
        answer, = scan(server, [one])
        assert set(answer["lip_error"]) == {"digger", "plate", "third"}
        last = ground(server)
        assert last[1]["residual"] == last[2]["residual"] == 0
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert ground(server) == last


def test_scans_while_states_are_taken_back_are_refused(tmp_path):
    path, flat = site(tmp_path), np.full(SHAPE, EYE[2], dtype="<f4")
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed([state for n in range(40) for state in
                     passes("digger", 0.0, 0.2 + 0.005 * n, 20, begin=1 + 2 * n)])

        async def work():
            loop, answers = asyncio.get_running_loop(), []
            async with server.connect("/scan") as sensor:
                undone = loop.run_in_executor(None, lambda: server.get("/undo?machine=digger&time=0", method="POST"))
                while not undone.done():
                    await sensor.send(message(DEPTH, flat.tobytes()))
                    answers.append(json.loads(await sensor.recv()))
            return await undone, answers
        (status, _), answers = asyncio.run(work())
        assert status == 200
        # A scan of level ground, before or after, agrees or fills what was dug; the others do nothing.
        refused = [answer for answer in answers if "error" in answer]
        assert refused and {answer["error"] for answer in refused} == {"states were taken back meanwhile; send the scan again"}


@pytest.mark.parametrize("sync", ["1", "always"])
def test_a_full_disk_is_told_and_the_correction_is_kept(tmp_path, sync):
    image, volume = pit()
    one, flat = message(DEPTH, image.tobytes()), message(DEPTH, FLAT)
    path = site(tmp_path, f"output: {{journal: {{sync: {sync}}}}}\n")
    with small_disk(tmp_path / "disk", 3000) as disk:
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            server.feed([PARKED])
            fill(disk)
            told, = scan(server, [one])
            assert "the ground is corrected by this scan, but that is not on disk yet" in told["error"]
            assert "No space left on device" in told["error"]
            kept = ground(server)
            assert kept[1]["surveyed_removed"] == pytest.approx(volume, rel=0.005)
            refused, = scan(server, [flat])
            assert "No space left on device" in refused["error"] and "corrected" not in refused["error"]
            assert ground(server) == kept
            (disk / "other").unlink()
            until = time.monotonic() + 60
            while "error" in (answer := scan(server, [flat])[0]):
                assert time.monotonic() < until and "No space left on device" in answer["error"]
                assert ground(server) == kept
                time.sleep(0.2)
            assert answer["added_m3"] == pytest.approx(volume, rel=0.005)
            last = ground(server)
            server.kill()
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            assert ground(server) == last
