# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A machine that drives: its base beside its joints, from its feed to the view."""
import math

import numpy as np
import pytest
from live import Server
from test_feeds import START
from test_machines import digest, machines
from test_scan import DEPTH, cab_sensor, excavator_site, message, pit, scan

LEVEL = [0.0, 0.0, 0.0, 1.0]


def at(x, y, z=0.0, yaw=0.0):
    return {"position": [x, y, z], "rotation": [0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)]}


def states(count=60):
    """A drive with the bucket held low; the base is sent now and then."""
    for i in range(count):
        state = {"machine": "excavator", "time": 0.2 * i,
                 "joints": {**START, "boom_joint": 0.1 + 0.1 * math.sin(i / 9)}}
        if i % 5 == 2:
            state["base"] = at(-0.1 * i, -4.0 + 0.02 * i, 0.0, 0.01 * i)
        yield state


def test_it_goes_on_from_its_base_after_a_restart_and_when_states_are_taken_back(tmp_path):
    all_states = list(states())
    for i, state in enumerate(all_states):  # those without a base are those of one that stands
        if i % 5 != 2 and i > 2:
            state["base"] = all_states[i - (i - 2) % 5]["base"]
    path = excavator_site(tmp_path)
    with Server(path, "--out", tmp_path / "told", cwd=tmp_path) as server:
        assert all("error" not in answer for answer in server.feed(all_states))
        told = digest(server)
        assert server.json("/summary.json")["volume_m3"]["cut"] > 0.2
        again, = server.feed([machines(server)["excavator"]["state"]])
        assert again["cut_m3"] == 0, "what it says can be fed"
    sent = list(states())
    with Server(path, "--out", tmp_path / "held", cwd=tmp_path) as server:
        server.feed(sent[:30])
        here = machines(server)["excavator"]["state"]
        assert here["base"] == sent[27]["base"]
        before = digest(server)
        server.stop()
    with Server(path, "--out", tmp_path / "held", cwd=tmp_path) as server:
        assert machines(server)["excavator"]["state"] == here
        # It drives off, and comes back when that is taken back.
        off, = server.feed([{**sent[30], "base": at(-9.0, -4.0)}])
        assert "error" not in off
        assert server.get(f"/undo?machine=excavator&time={sent[29]['time']}", method="POST")[0] == 200
        assert machines(server)["excavator"]["state"] == here and digest(server) == before
        status, answers = server.post("/feed", sent[30:])
        assert status == 200 and all("error" not in answer for answer in answers)
        assert digest(server) == told


def test_it_drove_also_in_states_that_were_not_placed(tmp_path):
    low = {**START, "boom_joint": 0.1}
    with Server(excavator_site(tmp_path), cwd=tmp_path) as server:
        def feed(time_s, **more):
            return server.feed([{"machine": "excavator", "time": time_s, "joints": low, **more}])[0]
        assert "error" not in feed(0, base=at(0, -4))
        for time_s, x in ((10, -1.0), (20, -2.0)):
            assert feed(time_s, base=at(x, -4), fix="rtk_float")["placed"] is False
        answer = feed(30, fix="rtk_fixed")
        assert "error" not in answer, answer
        assert machines(server)["excavator"]["state"]["base"]["position"] == [-2.0, -4.0, 0.0]
        feed(40, base=at(-1, -4))
        assert machines(server)["excavator"]["state"]["base"]["position"] == [-1.0, -4.0, 0.0]
        feed(50)
        assert machines(server)["excavator"]["state"]["base"]["position"] == [-1.0, -4.0, 0.0]


def test_a_sensor_on_a_link_is_where_it_drove(tmp_path):
    image, volume = pit()
    swing, yaw = 0.7, -0.4
    base = np.array([3.0, -7.0, 0.5])
    path = excavator_site(tmp_path, cab_sensor(base, swing + yaw))
    stretched = {"machine": "excavator", "joints": {**START, "boom_joint": 1.0, "arm_joint": -0.6}}
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = server.feed([
            {**stretched, "time": 0},
            {**stretched, "time": 10, "joints": {**stretched["joints"], "swing_joint": swing},
             "base": at(*base, yaw)},
            {**stretched, "time": 20, "base": at(*base + [0, -9, 0], yaw)}])
        assert all("error" not in answer for answer in answers), answers
        answer, = scan(server, [message({**DEPTH, "sensor": "cab", "time": 19.9}, image.tobytes())])
        assert "error" not in answer, answer
        assert answer["removed_m3"] == pytest.approx(volume, rel=0.005)


@pytest.mark.parametrize("change, why", [
    ({"base": [0, 0, 0]}, "'base' must be an object with 'position' and 'rotation' of the urdf's root"),
    ({"base": {"position": [0, 0, 0]}}, "'base' must be an object with 'position' and 'rotation'"),
    ({"base": {**at(0, 0), "yaw": 1}}, "'base': unknown key 'yaw'"),
    ({"base": {"position": [0, 0], "rotation": LEVEL}}, "'base': 'position' must be an array of 3 numbers"),
    ({"base": {"position": [0, 0, None], "rotation": LEVEL}}, "'base': 'position' [2] must be a number"),
    ({"base": {"position": [0, 0, 0], "rotation": [0, 0, 0, 1.5]}},
     "'base': 'rotation' must be a unit quaternion x, y, z, w; its length is 1.5"),
    ({"base": at(150, 0)}, "machine 'excavator': its base would move 150 m in one state"),
    ({"base": at(20, 0)}, "the base moves 20 m in 0.1 s since the state before; no machine does more than "
     "50 m/s"),
    ({"base": at(0, 0, 0, 3.0)}, "the base turns 3 rad in 0.1 s since the state before"),
])
def test_bases_that_cant_be_are_refused_and_change_nothing(tmp_path, change, why):
    state = {"machine": "excavator", "time": 0.0, "joints": START, "base": at(0, 0)}
    with Server(excavator_site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        first, = server.feed([state])
        assert "error" not in first, first
        before = digest(server)
        answer, = server.feed([{**state, "time": 0.1, **change}])
        assert why in answer["error"]
        posed = {"machine": "excavator", "time": 0.1, **at(0, 0), "base": at(0, 0)}
        answer, = server.feed([posed])
        assert answer["error"] == ("'base' goes with 'joints'; 'position' and 'rotation' are those of the "
                                   "bucket")
        assert digest(server) == before
        assert machines(server)["excavator"]["state"] == state
