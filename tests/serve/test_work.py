# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What machines did, as a person who watches them would say it."""
import csv
import math
import random

from live import Server, scenario
from test_feeds import START, excavator

SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\n"


def rows(server, query=""):
    status, body = server.get("/machines.csv" + query)
    assert status == 200
    return {row["machine"]: row for row in csv.DictReader(body.decode().splitlines())}


def turned(pitch):
    return [0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)]


def test_a_machine_that_is_parked_is_idle_whatever_its_sensors_say(tmp_path):
    rng = random.Random(1)

    def noise(sigma):
        return rng.gauss(0, sigma)

    def parked(machine, y, sigma_m, from_s, to_s):
        for i in range(int(5 * (to_s - from_s))):
            pitch = noise(0.003)
            yield {"machine": machine, "time": from_s + i / 5, "rotation": turned(pitch),
                   "position": [noise(sigma_m), y + noise(sigma_m), 2 + noise(sigma_m)]}
    path = scenario(tmp_path, "output: {journal: {sync: always}}\n")
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        both = zip(parked("digger", 0, 0.003, 0, 60), parked("plate", 9, 0.001, 0, 60))
        server.feed([state for pair in both for state in pair])
        # One goes on slowly, 2 cm in a second.
        server.feed({"machine": "digger", "time": 60 + i / 5, "position": [0.004 * i, 0, 2],
                     "rotation": turned(0)} for i in range(60))
        for time_s, wanted in ((5, "working"), (30, "idle"), (59, "idle"), (70, "working")):
            at = rows(server, f"?time={time_s}")
            assert at["digger"]["state"] == wanted, time_s
            assert at["plate"]["state"] == ("working" if time_s == 5 else "idle")


def test_joints_that_tremble_stand(tmp_path):
    rng = random.Random(2)
    with Server(excavator(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed({"machine": "excavator", "time": i / 2,
                     "joints": {name: value + rng.gauss(0, 0.001) for name, value in START.items()}}
                    for i in range(60))
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        assert rows(server, "?time=5")["excavator"]["state"] == "working"
        assert rows(server, "?time=29")["excavator"]["state"] == "idle"


def test_a_load_that_sticks_or_is_shaken_in_the_ground_is_one_cycle(tmp_path):
    """Loads by what the site answers; what a person counts, by the way of the bucket."""
    def states():
        time_s = 0.0

        def go(x, z, pitch):
            nonlocal time_s
            time_s += 0.1
            return {"machine": "digger", "time": time_s, "position": [x, 3.0 * cycle, z],
                    "rotation": turned(pitch)}
        for cycle in range(4):
            time_s += 3.0
            yield go(0.0, 1.0, -0.6)
            for i in range(41):
                yield go(0.1 * i, -0.25, -0.6)
            if cycle == 2:        # turns in the ground, and digs on
                for k in range(16):
                    yield go(4.0 + 0.1 * k, -0.3, -0.6 + 0.1 * min(k, 15 - k) * 2.4)
                for i in range(31):
                    yield go(5.6 + 0.1 * i, -0.25, -0.6 * min(1, i / 10))
            x = 8.6 if cycle == 2 else 4.0
            for i in range(20):
                yield go(x, -0.25 + 0.12 * i, -0.6 - 0.02 * i)
            # It tips, once not all, and goes back.
            upto = 8 if cycle == 1 else 26
            for i in [*range(upto), *range(upto, 0, -1)]:
                yield go(x, 2.1, -1.0 + 0.1 * i)
            for i in range(20):
                yield go(x, 2.1 + 0.02 * i, -1.0 + 0.02 * i)
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = server.feed(states())
        assert not [answer for answer in answers if "error" in answer]
        loads = [answer["bucket_m3"] for answer in answers]
        row = rows(server)["digger"]
        assert int(row["cycles"]) == 4, (row, [round(load, 2) for load in loads][::4])
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        assert rows(server)["digger"]["cycles"] == row["cycles"], "counted again from the recording"
        assert rows(server)["digger"]["last_load_m3"] == row["last_load_m3"]
