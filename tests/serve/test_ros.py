# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of ROS 2 between processes: machines moved by topics; loads, forces and ground published."""
import csv
import hashlib
import json
import math
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import peers
import pytest
import soilvdb
from live import PROGRAM, Server
from peers import Peer, grid_map, joint_state, number, odometry, pose_stamped, transforms, wrench
from test_feeds import DATA
from test_machines import digest, machines
from test_scan import excavator_site

KINDS = [pytest.param(kind, marks=pytest.mark.skipif(
    not peers.path_of(kind).exists(), reason=f"built without the DDS of {kind}_peer"))
    for kind in ("cyclone", "fast")]

SOIL = "soil: {repose_angle: 0.6, swell: 0.2, density: 1800, cohesion: 3000}\n"
BUCKET = "{width: 1.2, height: 0.9, profile: [[0, 0], [-0.5, 0.1], [-0.6, 0.6], [0, 0.9]]}"
BEGIN = 1000.0  # stamp 0 means none
LEVEL = [0.0, 0.0, 0.0, 1.0]


def text_of(time_s):
    return f"{time_s:.9f}"


def rows(count):
    """Of the demonstrations' motion: it digs in the ground of excavator_site()."""
    with open(DATA / "excavator.csv", encoding="ascii") as file:
        for row, _ in zip(csv.DictReader(file), range(count)):
            yield float(f"{BEGIN + float(row.pop('time')):.9f}"), {k: float(v) for k, v in row.items()}


def site(folder, motion, more=SOIL):
    """The excavator with a topic for its joints."""
    path = excavator_site(folder, more)
    path.write_text(path.read_text().replace("    base: {xyz", f"    motion: {motion}\n    base: {{xyz"))
    return path


def pose_site(folder, motion, more=SOIL):
    path = folder / "poses.yaml"
    path.write_text("soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0.0, slope: [0.02, 0.0]}}\nmachines:\n"
                    f"  - {{name: digger, bucket: {BUCKET}, motion: {motion}}}\n{more}")
    return path


def passing(states, depth=0.25):
    """Poses of a pass, by time."""
    for i in range(states):
        x = 4.0 * i / (states - 1)
        yield float(text_of(BEGIN + 0.02 * i)), [x, 0.0, 0.02 * x - depth, *LEVEL]


def state(time_s, numbers):
    return {"machine": "digger", "time": time_s, "position": numbers[:3], "rotation": numbers[3:]}


@pytest.fixture
def domain():
    if not peers.path_of("cyclone").exists():
        pytest.skip("built without Cyclone DDS or its idlc")
    return peers.free_domain()


def serve(path, domain, folder, *more, **env):
    return Server(path, "--ros", "--out", folder / "ros", *more, cwd=folder,
                  env={"ROS_DOMAIN_ID": str(domain), "ROS_LOCALHOST_ONLY": "1", **env})


def until(found, seconds=30):
    """Asks again and again, where there is no event to wait for."""
    end = time.monotonic() + seconds
    while not (result := found()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return result


def has_come_to(server, machine, time_s):
    until(lambda: machines(server)[machine]["time_s"] == time_s)


def fed(path, states, folder):
    """The digest of a site that was fed lines, and its machines."""
    with Server(path, "--out", folder / "fed", cwd=folder) as server:
        answers = server.feed(states)
        assert all("error" not in answer for answer in answers), answers
        return digest(server), machines(server)


@pytest.mark.parametrize("kind", KINDS)
def test_joints_dig_what_a_feed_digs_and_load_force_and_ground_come_back(tmp_path, domain, kind):
    path = site(tmp_path, "{topic: /joint_states}")
    motion = list(rows(50))
    want, want_machines = fed(path, [{"machine": "excavator", "time": t, "joints": j} for t, j in motion],
                              tmp_path)
    oracle = soilvdb.Site.open(path)
    for time_s, joints in motion:
        oracle.update("excavator", time=time_s, joints=joints)
    force = oracle.resistance("excavator")
    with serve(path, domain, tmp_path) as server, Peer(kind, domain) as node:
        node.writer("/joint_states", "sensor_msgs/JointState")
        node.reader("/soilvdb/excavator/wrench", "geometry_msgs/WrenchStamped")
        node.reader("/soilvdb/excavator/load", "std_msgs/Float64", "besteffort")
        node.reader("/soilvdb/excavator/load_kg", "std_msgs/Float64")
        node.reader("/soilvdb/ground", "grid_map_msgs/GridMap", "reliable", "latched")
        for time_s, joints in motion:
            # In another order, and with a joint of another machine.
            node.write("/joint_states", joint_state(text_of(time_s), {
                "wheel": 9.0, **dict(reversed(joints.items()))}))
        last_ns = round(motion[-1][0] * 1e9)
        of_last = wrench(node.until("/soilvdb/excavator/wrench", lambda m: wrench(m)[0] == last_ns))
        assert digest(server) == want
        now, of_feed = machines(server)["excavator"], want_machines["excavator"]
        assert now["state"] == of_feed["state"] and now["bucket_m3"] == of_feed["bucket_m3"] > 0.1
        assert (now["link"], now["owner"]) == ("live", "ROS 2 topic /joint_states")
        assert of_last[1] == "excavator_bucket"
        assert of_last[2] == [*force.force, *force.moment] and np.linalg.norm(of_last[2][:3]) > 100
        node.until("/soilvdb/excavator/load", lambda m: number(m) == now["bucket_m3"])
        kg = server.json("/summary.json")["machines"][0]["bucket_kg"]
        node.until("/soilvdb/excavator/load_kg", lambda m: number(m) == kg)
        compare_ground(server, node)
        server.stop()


def heights_of(grid):
    """World coordinates and heights of a map's known cells, as grid_map defines them."""
    (_, columns, size), (_, rows, stride) = grid["dim"]
    assert (size, stride) == (columns * rows, rows) and len(grid["data"]) == size
    length, middle = np.array(grid["length"]), np.array(grid["pose"][:2])
    assert np.allclose(length, np.array([rows, columns]) * grid["cell"])
    data = np.array(grid["data"]).reshape(columns, rows)
    x = middle[0] + length[0] / 2 - grid["cell"] * (0.5 + np.arange(rows))
    y = middle[1] + length[1] / 2 - grid["cell"] * (0.5 + np.arange(columns))
    for c in range(columns):
        for r in range(rows):
            if not math.isnan(data[c, r]):
                yield x[r], y[c], data[c, r]


def compare_ground(server, node):
    """The newest map has the heights that the site tells."""
    def height(x, y):
        return server.json(f"/height?x={float(x)!r}&y={float(y)!r}")["height_m"]

    def is_now(message):
        grid = grid_map(message)
        assert (grid["layers"], grid["basic_layers"]) == (["elevation"], ["elevation"])
        assert (grid["frame"], grid["pose"][2:], grid["starts"]) == ("map", [0.0, *LEVEL], [0, 0])
        known = list(heights_of(grid))
        deep = [place for place in known if place[2] < -0.15]
        looked = deep[::max(1, len(deep) // 40)] + known[::max(1, len(known) // 40)]
        return len(deep) > 20 and all(abs(height(x, y) - z) < 1e-5 for x, y, z in looked)
    return grid_map(node.until("/soilvdb/ground", is_now))


def test_a_node_that_comes_later_gets_the_ground(tmp_path, domain):
    path = pose_site(tmp_path, "{topic: /pose}")
    poses = list(passing(50))
    with serve(path, domain, tmp_path) as server:
        with Peer("cyclone", domain) as node:
            node.writer("/pose", "geometry_msgs/PoseStamped", "besteffort")
            for time_s, numbers in poses[:1]:
                node.write("/pose", pose_stamped(text_of(time_s), numbers))
            has_come_to(server, "digger", poses[0][0])
            for time_s, numbers in poses[1:]:
                node.write("/pose", pose_stamped(text_of(time_s), numbers))
            has_come_to(server, "digger", poses[-1][0])
            node.reader("/soilvdb/ground", "grid_map_msgs/GridMap", "reliable", "latched")
            compare_ground(server, node)
        with Peer("cyclone", domain) as later:
            later.reader("/soilvdb/ground", "grid_map_msgs/GridMap", "reliable", "latched")
            compare_ground(server, later)


def test_machines_of_other_feeds_are_published_too(tmp_path, domain):
    """Also of rigid soil, which has no mass and no force; and machines that come later."""
    path = pose_site(tmp_path, "{topic: /pose}", "")
    with serve(path, domain, tmp_path) as server, Peer("cyclone", domain) as node:
        status, _ = server.post("/machines", json.dumps(
            {"add": {"name": "new-comer", "bucket": {"width": 1.0, "height": 0.6}}}).encode())
        assert status == 200
        node.reader("/soilvdb/digger/load", "std_msgs/Float64")
        node.reader("/soilvdb/new_comer/load", "std_msgs/Float64")
        node.reader("/soilvdb/ground", "grid_map_msgs/GridMap", "reliable", "latched")
        for name, y in (("digger", 0.0), ("new-comer", 3.0)):
            *_, last = server.feed([{**state(t, [x, y, z, *LEVEL]), "machine": name}
                                    for t, (x, _, z, *_) in passing(40)])
            assert last["bucket_m3"] > 0.1
            node.until(f"/soilvdb/{ros_name(name)}/load", lambda m: number(m) == last["bucket_m3"])
        compare_ground(server, node)


def ros_name(name):
    return re.sub("[^A-Za-z0-9]", "_", name)


def test_a_run_of_the_recording_digs_the_same(tmp_path, domain):
    """The names that a scenario has for a recording serve for topics as well."""
    motion = list(rows(60))
    with open(tmp_path / "drive.csv", "w", encoding="ascii") as file:
        table = csv.DictWriter(file, ["time", *motion[0][1]])
        table.writeheader()
        for time_s, joints in motion:
            table.writerow({"time": text_of(time_s), **joints})
    subprocess.run([sys.executable, Path(__file__).parents[1] / "mcap" / "make_mcap.py", tmp_path / "drive.mcap",
                    f"joints:/joint_states:{tmp_path / 'drive.csv'}"], check=True)
    path = site(tmp_path, "{mcap: drive.mcap, topic: /joint_states}", "")
    subprocess.run([PROGRAM, "run", path, "--out", tmp_path / "run"], check=True, capture_output=True)
    want = json.loads((tmp_path / "run" / "summary.json").read_text())
    with serve(path, domain, tmp_path) as server, Peer("cyclone", domain) as node:
        node.writer("/joint_states", "sensor_msgs/JointState")
        for time_s, joints in motion:
            node.write("/joint_states", joint_state(text_of(time_s), joints))
        has_come_to(server, "excavator", motion[-1][0])
        assert digest(server) == want["state_hash"] and want["volume_m3"]["cut"] > 0.1


def base_at(i):
    """Of a machine that drives and turns."""
    yaw = 0.004 * i
    return [0.02 * i, -4.0 - 0.01 * i, 0.01, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("how", ["tf", "odometry", "pose"])
def test_a_base_comes_by_transforms_or_odometry(tmp_path, domain, kind, how):
    base = "{topic: /tf, frame: base_link, parent: map}" if how == "tf" else "{topic: /base}"
    path = site(tmp_path, f"{{topic: [/arm, /swing], base: {base}}}")
    motion = [(t, j, base_at(i)) for i, (t, j) in enumerate(rows(60))]
    states = [{"machine": "excavator", "time": t, "joints": j,
               "base": {"position": b[:3], "rotation": b[3:]}} for t, j, b in motion]
    want, want_machines = fed(path, states, tmp_path)
    with serve(path, domain, tmp_path) as server, Peer(kind, domain) as node:
        for topic in ("/arm", "/swing"):
            node.writer(topic, "sensor_msgs/JointState")
        if how == "tf":
            node.writer("/tf", "tf2_msgs/TFMessage")
            node.writer("/tf_static", "tf2_msgs/TFMessage", "reliable", "latched")
            # The map is where odom is; another machine's frames are there, too.
            node.write("/tf_static", transforms(("7.0", "map", "odom", [0, 0, 0, *LEVEL])))
        else:
            node.writer("/base", "nav_msgs/Odometry" if how == "odometry" else "geometry_msgs/PoseStamped")
        for time_s, joints, numbers in motion:
            text = text_of(time_s)
            swing = {k: v for k, v in joints.items() if k == "swing_joint"}
            node.write("/swing", joint_state(text, swing))
            if how == "tf":
                node.write("/tf", transforms((text, "other", "base", [1, 2, 3, *LEVEL]),
                                             (text, "odom", "base_link", numbers)))
            else:
                node.write("/base", (odometry if how == "odometry" else pose_stamped)(text, numbers))
            node.write("/arm", joint_state(text, {k: v for k, v in joints.items() if k != "swing_joint"}))
        has_come_to(server, "excavator", motion[-1][0])
        now = machines(server)["excavator"]["state"]
        assert now == want_machines["excavator"]["state"]
        assert digest(server) == want


def test_transforms_move_a_bucket_and_are_interpolated(tmp_path, domain):
    """Of a chain with a fixed link, and a base whose stamps lie between those of the bucket."""
    path = pose_site(tmp_path, "{topic: /tf, frame: bucket, parent: map}")
    with serve(path, domain, tmp_path) as server, Peer("cyclone", domain) as node:
        node.writer("/tf", "tf2_msgs/TFMessage")
        node.writer("/tf_static", "tf2_msgs/TFMessage", "reliable", "latched")
        node.reader("/soilvdb/digger/wrench", "geometry_msgs/WrenchStamped")
        node.write("/tf_static", transforms(("0.0", "base", "mast", [0, 0, 0.5, *LEVEL])))
        for i in range(40):
            time_s, x = BEGIN + 0.1 * i, 0.05 * i
            node.write("/tf", transforms((text_of(time_s - 0.05), "map", "base", [x, 1.0, -0.25, *LEVEL]),
                                         (text_of(time_s), "mast", "bucket", [0.0, 0.0, -0.5, *LEVEL])))
        # A stamp is known when the base is known after it.
        last = float(text_of(BEGIN + 0.1 * 38))
        stamp, frame, _ = wrench(node.until("/soilvdb/digger/wrench",
                                            lambda m: wrench(m)[0] == round(last * 1e9)))
        assert frame == "bucket"
        has_come_to(server, "digger", float(text_of(BEGIN + 3.9)))  # waited for, and held
        now = machines(server)["digger"]["state"]
        assert now["position"] == pytest.approx([0.05 * 39, 1.0, -0.25], abs=1e-12)
        recorded = server.stop()
        assert "isn't known" not in recorded, recorded
    want = [state(float(text_of(BEGIN + 0.1 * i)),
                  [0.05 * (i + 0.5) if i < 39 else 0.05 * 39, 1.0, -0.25, *LEVEL]) for i in range(40)]
    want[0]["position"][0] = 0.025
    _, fed_machines = fed(pose_site(tmp_path, "{topic: /tf, frame: bucket, parent: map}"), want, tmp_path)
    assert now["position"] == pytest.approx(fed_machines["digger"]["state"]["position"], abs=1e-12)


# Type descriptions as ROS 2's packages define them (REP-2011).
FIELDS = {
    "builtin_interfaces/msg/Time": "int32 sec, uint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/msg/Time stamp, string frame_id",
    "std_msgs/msg/Float64": "float64 data",
    "std_msgs/msg/MultiArrayDimension": "string label, uint32 size, uint32 stride",
    "std_msgs/msg/MultiArrayLayout": "std_msgs/msg/MultiArrayDimension[] dim, uint32 data_offset",
    "std_msgs/msg/Float32MultiArray": "std_msgs/msg/MultiArrayLayout layout, float32[] data",
    "geometry_msgs/msg/Vector3": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Point": "float64 x, float64 y, float64 z",
    "geometry_msgs/msg/Quaternion": "float64 x, float64 y, float64 z, float64 w",
    "geometry_msgs/msg/Transform":
        "geometry_msgs/msg/Vector3 translation, geometry_msgs/msg/Quaternion rotation",
    "geometry_msgs/msg/TransformStamped":
        "std_msgs/msg/Header header, string child_frame_id, geometry_msgs/msg/Transform transform",
    "geometry_msgs/msg/Pose": "geometry_msgs/msg/Point position, geometry_msgs/msg/Quaternion orientation",
    "geometry_msgs/msg/PoseStamped": "std_msgs/msg/Header header, geometry_msgs/msg/Pose pose",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/msg/Pose pose, float64[36] covariance",
    "geometry_msgs/msg/Twist": "geometry_msgs/msg/Vector3 linear, geometry_msgs/msg/Vector3 angular",
    "geometry_msgs/msg/TwistWithCovariance": "geometry_msgs/msg/Twist twist, float64[36] covariance",
    "geometry_msgs/msg/Wrench": "geometry_msgs/msg/Vector3 force, geometry_msgs/msg/Vector3 torque",
    "geometry_msgs/msg/WrenchStamped": "std_msgs/msg/Header header, geometry_msgs/msg/Wrench wrench",
    "nav_msgs/msg/Odometry":
        "std_msgs/msg/Header header, string child_frame_id, geometry_msgs/msg/PoseWithCovariance pose, "
        "geometry_msgs/msg/TwistWithCovariance twist",
    "sensor_msgs/msg/JointState":
        "std_msgs/msg/Header header, string[] name, float64[] position, float64[] velocity, float64[] effort",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/msg/TransformStamped[] transforms",
    "grid_map_msgs/msg/GridMapInfo":
        "float64 resolution, float64 length_x, float64 length_y, geometry_msgs/msg/Pose pose",
    "grid_map_msgs/msg/GridMap":
        "std_msgs/msg/Header header, grid_map_msgs/msg/GridMapInfo info, string[] layers, "
        "string[] basic_layers, std_msgs/msg/Float32MultiArray[] data, uint16 outer_start_index, "
        "uint16 inner_start_index",
}
TYPE_IDS = {"uint16": 5, "int32": 6, "uint32": 7, "float32": 10, "float64": 11, "string": 17}


def described(name):
    """A type's description, and the names of those that it is made of."""
    fields, parts = [], set()
    for field in FIELDS[name].split(", "):
        kind, count, label = re.fullmatch(r"([^\[ ]+)(\[\d*\])? (\w+)", field).groups()
        length = (count or "").strip("[]")
        nested = kind not in TYPE_IDS
        if nested:
            parts |= {kind} | described(kind)[1]
        fields.append({"name": label, "type": {
            "type_id": TYPE_IDS.get(kind, 1) + (0 if count is None else 48 if length else 144),
            "capacity": int(length or 0), "string_capacity": 0,
            "nested_type_name": kind if nested else ""}})
    return {"type_name": name, "fields": fields}, parts


def type_hash(name):
    description, parts = described(name)
    text = json.dumps({"type_description": description,
                       "referenced_type_descriptions": [described(part)[0] for part in sorted(parts)]})
    return f"typehash=RIHS01_{hashlib.sha256(text.encode()).hexdigest()};"


def test_the_hash_here_is_that_of_ros():
    """As published with it."""
    assert type_hash("tf2_msgs/msg/TFMessage") == (
        "typehash=RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087;")


@pytest.mark.parametrize("kind", KINDS)
def test_readers_and_writers_show_the_hashes_of_their_types(tmp_path, domain, kind):
    path = site(tmp_path, "{topic: /joint_states, base: {topic: /tf, frame: base_link, parent: map}}")
    more = (f"  - {{name: 2nd digger, bucket: {BUCKET}, motion: {{topic: /pose}}}}\n"
            f"  - {{name: third, bucket: {BUCKET}, motion: {{topic: /odom}}}}\n")
    path.write_text(path.read_text().replace("soil:", more + "soil:", 1))
    with serve(path, domain, tmp_path), Peer(kind, domain) as node:
        for topic, name in [("/joint_states", "sensor_msgs/JointState"), ("/tf", "tf2_msgs/TFMessage"),
                            ("/pose", "geometry_msgs/PoseStamped"), ("/odom", "nav_msgs/Odometry")]:
            assert node.writer(topic, name) == type_hash(name.replace("/", "/msg/"))
        assert node.writer("/tf_static", "tf2_msgs/TFMessage", "reliable", "latched") == type_hash(
            "tf2_msgs/msg/TFMessage")
        for topic, name in [("/soilvdb/_2nd_digger/load", "std_msgs/Float64"),
                            ("/soilvdb/excavator/wrench", "geometry_msgs/WrenchStamped"),
                            ("/soilvdb/ground", "grid_map_msgs/GridMap")]:
            assert node.reader(topic, name) == type_hash(name.replace("/", "/msg/"))


def test_bad_messages_are_refused_in_words_and_nothing_else_suffers(tmp_path, domain):
    path = pose_site(tmp_path, "{topic: /pose}",
                     f"  - {{name: other, bucket: {BUCKET}, motion: {{topic: /odom}}}}\n" + SOIL)
    poses = list(passing(40))
    want, _ = fed(path, [state(*pose) for pose in poses], tmp_path)
    with serve(path, domain, tmp_path) as server, Peer("cyclone", domain) as node, \
            Peer("cyclone", domain) as liar:
        node.writer("/pose", "geometry_msgs/PoseStamped")
        for pose in poses[:20]:
            node.write("/pose", pose_stamped(text_of(pose[0]), pose[1]))
        has_come_to(server, "digger", poses[19][0])
        # A number that says it is an odometry: its eight bytes are a stamp, and then it ends.
        liar.writer("/odom", "nav_msgs/Odometry=std_msgs/Float64")
        of = peers.cdr()
        of.put("d", 1.5)
        liar.write("/odom", of.message())
        liar.close("/odom")
        liar.writer("/odom", "nav_msgs/Odometry")
        liar.write("/odom", odometry("1000.0", [0, 9, 1, 0, 0, 0, 0.5]))
        liar.write("/odom", odometry("1000.1", [math.nan, 9, 1, *LEVEL]))
        liar.write("/odom", odometry("1000.2", [0, 9, 1, *LEVEL]))
        has_come_to(server, "other", 1000.2)
        for pose in poses[20:]:
            node.write("/pose", pose_stamped(text_of(pose[0]), pose[1]))
        has_come_to(server, "digger", poses[-1][0])
        said = server.stop()
    assert ("warning: machine 'other': ROS 2 topic /odom: a message of nav_msgs/Odometry "
            "ends within a field") in said
    assert "digger" not in said.replace("/digger", ""), said
    with Server(path, "--out", tmp_path / "again", cwd=tmp_path) as server:
        server.feed([*(state(*pose) for pose in poses[:20]),
                     {**state(1000.2, [0.0, 9.0, 1.0, *LEVEL]), "machine": "other"},
                     *(state(*pose) for pose in poses[20:])])
        again = digest(server)
    with Server(path, "--out", tmp_path / "ros", cwd=tmp_path) as server:
        assert digest(server) == again, "what was taken is in the journal"


@pytest.mark.parametrize("message", [
    b"\0\1", b"\0\1\0\0", b"\0\3\0\0" + bytes(80), b"\0\1\0\0" + bytes(7),
    pose_stamped("1000.0", [0, 0, 0, *LEVEL])[:-4],
    b"\0\1\0\0" + bytes(8) + b"\xff\xff\xff\xff" + bytes(60)],
    ids=["half a head", "a head", "another encoding", "half a stamp", "a number short", "a huge text"])
def test_no_bytes_of_another_implementation_stop_it(tmp_path, domain, message):
    if not peers.path_of("fast").exists():
        pytest.skip("built without the DDS of fast_peer")
    path = pose_site(tmp_path, "{topic: /pose}")
    poses = list(passing(10))
    with serve(path, domain, tmp_path) as server, Peer("fast", domain) as node:
        node.writer("/pose", "geometry_msgs/PoseStamped")
        node.write("/pose", message)
        for pose in poses:
            node.write("/pose", pose_stamped(text_of(pose[0]), pose[1]))
        has_come_to(server, "digger", poses[-1][0])
        node.end()
        said = server.stop()
    # Shorter than a head, it is no message of DDS.
    assert len(message) < 4 or "/pose: a message of geometry_msgs/PoseStamped " in said, said


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("how", ["silent", "killed", "closed", "ended"])
def test_a_publisher_that_falls_silent_or_vanishes_is_a_lost_link(tmp_path, domain, kind, how):
    path = pose_site(tmp_path, "{topic: /pose}")
    poses = list(passing(30))
    with serve(path, domain, tmp_path) as server, Peer(kind, domain) as node:
        assert machines(server)["digger"]["link"] == "none"
        node.writer("/pose", "geometry_msgs/PoseStamped")
        for pose in poses[:10]:
            node.write("/pose", pose_stamped(text_of(pose[0]), pose[1]))
        has_come_to(server, "digger", poses[9][0])
        now = machines(server)["digger"]
        assert (now["link"], now["owner"]) == ("live", "ROS 2 topic /pose")
        refused, = server.feed([state(*poses[10])])
        assert "machine 'digger' is fed by ROS 2 topic /pose" in refused["error"]
        if how == "killed":
            node.kill()
        elif how == "closed":
            node.close("/pose")
        elif how == "ended":
            node.end()
        until(lambda: machines(server)["digger"]["link"] == "lost", 20)
        taken, = server.feed([state(*poses[10])])
        assert "error" not in taken, "another feed takes over"
        if how == "silent":  # it is heard again when the other's feed has ended
            until(lambda: machines(server)["digger"]["link"] == "none")
            node.write("/pose", pose_stamped(text_of(poses[11][0]), poses[11][1]))
            has_come_to(server, "digger", poses[11][0])
            assert machines(server)["digger"]["link"] == "live"


def test_a_topic_of_another_type_is_told(tmp_path, domain):
    path = site(tmp_path, "{topic: /joint_states}")
    with serve(path, domain, tmp_path) as server, Peer("cyclone", domain) as node:
        node._send("writer", "/joint_states", "std_msgs/Float64", "reliable", "volatile")
        line = server.process.stderr.readline()
        while "is published as" not in line:
            assert line
            line = server.process.stderr.readline()
    assert line.strip() == ("soilvdb: warning: ROS 2: topic 'rt/joint_states' is published as "
                            "std_msgs::msg::dds_::Float64_; it is read as "
                            "sensor_msgs::msg::dds_::JointState_")


def test_a_reliable_topic_is_still_read_when_somebody_publishes_it_as_best_effort(tmp_path, domain):
    path = pose_site(tmp_path, "{topic: /pose}")
    poses = list(passing(2000))
    with serve(path, domain, tmp_path) as server, Peer("cyclone", domain) as first, \
            Peer("cyclone", domain) as second:
        for i, (node, reliability) in enumerate([(first, "reliable"), (second, "besteffort")]):
            node.writer("/pose", "geometry_msgs/PoseStamped", reliability)
            node.write("/pose", pose_stamped(text_of(poses[i][0]), poses[i][1]))
            has_come_to(server, "digger", poses[i][0])
        later = iter(poses[2:])

        def is_heard():  # as soon as it knows the reader that took the place of the first
            time_s, numbers = next(later)
            first.write("/pose", pose_stamped(text_of(time_s), numbers))
            return machines(server)["digger"]["time_s"] >= poses[2][0]
        until(is_heard)


@pytest.mark.parametrize("motion, arguments, env, why", [
    ("{topic: /tf, frame: bucket}", [], {}, "name the world's frame as 'parent: map' beside 'frame'"),
    ("{topic: [/a, /b]}", [], {}, "several topics are for joints only, so name one"),
    ("{topic: /pose}", ["--speed", "1"], {}, "--ros and --speed both move machines"),
    ("{topic: /pose}", [], {"ROS_DOMAIN_ID": "233"}, "ROS_DOMAIN_ID is '233'; it must be a whole number "
                                                     "from 0 to 232"),
    ("{topic: /pose}", [], {"ROS_DOMAIN_ID": "1e1"}, "ROS_DOMAIN_ID is '1e1'; it must be a whole number"),
])
def test_what_cannot_work_is_refused_before_anything_is_written(tmp_path, motion, arguments, env, why):
    path = pose_site(tmp_path, motion)
    tried = subprocess.run([PROGRAM, "serve", path, "--port", "0", "--ros", "--out", tmp_path / "out", *arguments],
                           text=True, capture_output=True, timeout=60,
                           env={**os.environ, "ROS_LOCALHOST_ONLY": "1", **env})
    said = [line for line in tried.stderr.splitlines() if "the page isn't built" not in line]
    assert tried.returncode == 2 and len(said) == 1 and why in said[0], tried.stderr
    assert not (tmp_path / "out").exists()


def test_machines_whose_topics_would_be_the_same_are_refused(tmp_path, domain):
    more = "".join(f"  - {{name: {name}, bucket: {BUCKET}}}\n" for name in ("a-b", "a_b")) + SOIL
    path = pose_site(tmp_path, "{topic: /pose}", more)
    tried = subprocess.run([PROGRAM, "serve", path, "--port", "0", "--ros", "--out", tmp_path / "out"], text=True,
                           capture_output=True, timeout=60, env={**os.environ, "ROS_DOMAIN_ID": str(domain)})
    both = "machines 'a-b' and '{}' would both have the topics /soilvdb/a_b of ROS 2; rename one of them"
    assert tried.returncode == 2 and both.format("a_b") in tried.stderr, tried.stderr
    assert not (tmp_path / "out").exists()
    path.write_text(path.read_text().replace("name: a_b", "name: c"))
    with serve(path, domain, tmp_path) as server:
        def change(what):
            status, (answer,) = server.post("/machines", [what])
            return answer.get("error", status)
        def added(name):
            return {"add": {"name": name, "bucket": {"width": 1.0, "height": 0.6}}}
        assert change(added("a_b")) == both.format("a_b") and change(added("a.b")) == both.format("a.b")
        assert change({"rename": {"from": "c", "to": "a b"}}) == both.format("a b")
        assert [machine["name"] for machine in server.json("/machines")["machines"]] == ["digger", "a-b", "c"]
        # One may take the topics of another that is gone, which then can't come back.
        assert change({"rename": {"from": "a-b", "to": "a_b"}}) == change({"retire": "a_b"}) == 200
        assert change(added("a b")) == 200
        assert change({"restore": "a_b"}) == both.replace("'a-b'", "'a b'").format("a_b")


@pytest.mark.parametrize("form", ["text", "file"])
@pytest.mark.parametrize("name", ["address='127.0.0.1'", 'name="lo"'])
def test_this_computer_alone_may_be_named_twice(tmp_path, domain, form, name):
    """As the variable of ROS and as the interface of a configuration; peers and the rest of it hold."""
    config = (f"<CycloneDDS><Domain><General><Interfaces><NetworkInterface {name} multicast='false'/></Interfaces>"
              "</General></Domain></CycloneDDS>")
    (tmp_path / "dds.xml").write_text(config)
    uri = config if form == "text" else f"file://{tmp_path / 'dds.xml'}"
    path = pose_site(tmp_path, "{topic: /pose}")
    with serve(path, domain, tmp_path, CYCLONEDDS_URI=uri) as server, Peer("cyclone", domain) as node:
        node.writer("/pose", "geometry_msgs/PoseStamped")
        (time_s, numbers), *_ = passing(3)
        node.write("/pose", pose_stamped(text_of(time_s), numbers))
        has_come_to(server, "digger", time_s)


def test_a_build_without_dds_tells_how_to_get_it(tmp_path):
    path = pose_site(tmp_path, "{topic: /pose}")
    try:
        with serve(path, peers.free_domain(), tmp_path):
            pytest.skip("built with Cyclone DDS")
    except AssertionError as refused:
        assert str(refused).endswith("soilvdb: --ros: this build has no ROS 2: install cyclonedds-dev (0.10), "
                                     "and then build soilvdb again\n")
    assert not (tmp_path / "ros").exists()


def test_a_run_needs_the_recording(tmp_path):
    path = pose_site(tmp_path, "{topic: /pose}")
    tried = subprocess.run([PROGRAM, "run", path], text=True, capture_output=True, timeout=60)
    assert tried.returncode == 2 and tried.stderr.strip().endswith(
        "poses.yaml:5: the motion has no 'mcap'; name the recording. Topics alone move machines of "
        "'soilvdb serve --ros'"), tried.stderr


def test_the_program_starts_without_dds():
    linked = subprocess.run(["ldd", PROGRAM], text=True, capture_output=True, check=True).stdout
    assert "libc.so" in linked and "ddsc" not in linked
