# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Machines and hoppers that come to a running site, change their names and leave it."""
import asyncio
import csv
import io
import json
import math
import random
import subprocess
from pathlib import Path

import pytest
from live import PROGRAM, Server, passes, scenario
from test_feeds import START

SOIL = ("soil: {repose_angle: 0.6, swell: 0.2}\n"
        "output: {snapshots: {every: 0.3, incremental: true}, journal: {sync: always}}\n")
THIRD = {"name": "third", "bucket": {"width": 0.8, "height": 0.5, "profile": [[0, 0], [-0.4, 0.1], [0, 0.5]]}}
IN_YAML = "  - " + json.dumps(THIRD) + "\n"
DATA = Path(__file__).parents[2] / "data"


def change(server, path, what):
    status, (answer,) = server.post(path, json.dumps(what))
    assert status == 200, answer
    return answer


def names(server):
    return [machine["name"] for machine in server.json("/machines")["machines"]]


def figures(server, query=""):
    """Ground and balance."""
    summary = server.json("/summary.json" + query)
    return summary["state_hash"], summary["volume_m3"], summary.get("mass_kg")


def take(server, states):
    bad = [answer for answer in server.feed(states) if "error" in answer]
    assert not bad, bad[0]


def dump(machine, begin, y=0.0, states=60):
    """Digs a pass, lifts, goes on and tips the load at x = 9."""
    yield from passes(machine, y, 0.3, states, begin)
    for i in range(1, states + 1):
        t = i / states
        lift, turn = min(1, 3 * t), max(0, 3 * t - 2) * 2.0
        yield {"machine": machine, "time": begin + 0.6 + 0.02 * i,
               "position": [4 + 5 * min(1, 1.5 * t), y, -0.22 + 2.5 * lift],
               "rotation": [0.0, math.sin(turn / 2), 0.0, math.cos(turn / 2)]}


def test_buckets_that_are_small_beside_the_voxels_are_warned_of(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text("soilvdb: 1\nvoxel_size: 0.5\nterrain: {plane: {z: 0}}\nmachines:\n" + IN_YAML)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answer = change(server, "/machines", {"add": {"name": "fourth", "bucket": {"width": 1.2, "height": 1.0}}})
        assert "warning" not in answer
        answer = change(server, "/machines", {"add": {"name": "fifth", "bucket": {"width": 1.2, "height": 0.9}}})
        assert answer["warning"].startswith("voxels of 0.5 m are too large for the bucket of fifth, 1.2 m x 0.9 m")
        assert (f"{path}: voxels of 0.5 m are too large for the bucket of third, 0.8 m x 0.5 m"
                in server.stop())


def test_a_machine_that_comes_digs_as_one_that_was_always_there(tmp_path):
    path, out = scenario(tmp_path, SOIL), tmp_path / "out"
    first, second = list(passes("digger", 0.0, 0.2, 40)), list(passes("third", 2.0, 0.2, 40, begin=0.1))
    with Server(path, "--out", out, cwd=tmp_path) as server:
        async def work():
            async with server.connect("/view") as viewer:
                site = json.loads(await viewer.recv())
                loop = asyncio.get_running_loop()
                await loop.run_in_executor(None, take, server, first[:20])
                told = await loop.run_in_executor(None, change, server, "/machines", {"add": THIRD})
                assert told == {"machines": ["digger", "plate", "third"]}
                async with asyncio.timeout(30):
                    while True:
                        message = await viewer.recv()
                        now = json.loads(message) if isinstance(message, str) else {}
                        if now.get("type") == "site":
                            break
                    assert [m["name"] for m in now["machines"]] == told["machines"] != [
                        m["name"] for m in site["machines"]]
                    while "machines" not in now or now["type"] != "state" or len(now["machines"]) != 3:
                        message = await viewer.recv()
                        now = json.loads(message) if isinstance(message, str) else {}
        asyncio.run(work())
        assert server.post("/feed", [second[0]])[0] == 200
        take(server, [state for pair in zip(first[20:30], second[1:11]) for state in pair])
        early = figures(server, "?time=0.15")
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert names(server) == ["digger", "plate", "third"]
        assert figures(server, "?time=0.15") == early
        take(server, [*first[30:], *second[11:]])
        dug = figures(server)
        rows = {row["machine"] for row in csv.DictReader(io.StringIO(server.get("/report.csv")[1].decode()))}
        assert "third" in rows
        server.stop()
    with Server(out, cwd=tmp_path) as server:
        assert figures(server) == dug and "third" in server.get("/machines.csv")[1].decode()
        assert figures(server, "?time=0.15") == early
    done = subprocess.run([PROGRAM, "verify", out], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done
    path.write_text(path.read_text().replace("soil:", IN_YAML + "soil:"))
    with Server(path, "--out", tmp_path / "always", cwd=tmp_path) as server:
        take(server, [*first[:20], second[0]])
        take(server, [state for pair in zip(first[20:30], second[1:11]) for state in pair])
        take(server, [*first[30:], *second[11:]])
        assert figures(server) == dug
    # The scenario may not have it as well.
    done = subprocess.run([PROGRAM, "serve", path, "--out", out, "--port", "0"], capture_output=True,
                          text=True, timeout=60)
    assert done.returncode == 2 and "does not fit the scenario now: 'third' is the name of a machine" in done.stderr


def test_machines_that_follow_in_the_scenario_come_after_those_that_came(tmp_path):
    path, out = scenario(tmp_path, SOIL), tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        change(server, "/machines", {"add": THIRD})
        take(server, passes("third", 2.0, 0.2, 30))
        dug = figures(server)
        server.stop()
    fourth = {**THIRD, "name": "fourth"}
    path.write_text(path.read_text().replace("soil:", "  - " + json.dumps(fourth) + "\nsoil:"))
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert names(server) == ["digger", "plate", "third", "fourth"] and figures(server) == dug
        change(server, "/machines", {"add": {**THIRD, "name": "fifth"}})
        take(server, passes("fifth", 4.0, 0.2, 30, begin=0.3))
        dug = figures(server)
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert names(server) == ["digger", "plate", "third", "fourth", "fifth"] and figures(server) == dug


def test_machines_change_their_names_retire_and_come_back(tmp_path):
    path, out = scenario(tmp_path, SOIL), tmp_path / "out"
    states = list(passes("digger", 0.0, 0.2, 60))
    renamed = [{**state, "machine": "bagger"} for state in states]
    with Server(path, "--out", out, cwd=tmp_path) as server:
        take(server, states[:20])
        change(server, "/machines", {"rename": {"from": "digger", "to": "bagger"}})
        refused, taken = server.feed([states[20], renamed[20]])
        assert "there is no machine 'digger'" in refused["error"] and "error" not in taken
        assert change(server, "/machines", {"retire": "plate"}) == {"machines": ["bagger"]}
        refused, = server.feed([next(passes("plate", 3.0, 0.2, 20))])
        assert "machine 'plate' is retired" in refused["error"]
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert names(server) == ["bagger"]
        for at in ("", "?time=0.1"):
            rows = list(csv.DictReader(io.StringIO(server.get("/machines.csv" + at)[1].decode())))
            assert [row["machine"] for row in rows] == ["bagger"]
        take(server, renamed[21:40])
        change(server, "/machines", {"retire": "bagger"})
        assert names(server) == [] and server.json("/alarms") is not None
        assert change(server, "/machines", {"restore": "bagger"}) == {"machines": ["bagger"]}
        take(server, renamed[40:])
        assert change(server, "/machines", {"restore": "plate"}) == {"machines": ["bagger", "plate"]}
        dug = figures(server)
        server.stop()
    with Server(path, "--out", tmp_path / "alone", cwd=tmp_path) as server:
        take(server, states)
        assert figures(server) == dug


def test_a_machine_with_joints_comes(tmp_path):
    path = scenario(tmp_path)
    (tmp_path / "excavator.urdf").write_text((DATA / "excavator.urdf").read_text())
    joint_machine = {"name": "excavator", "urdf": "excavator.urdf", "bucket": {"width": 1.0, "height": 0.6},
                     "lip": {"link": "bucket_link", "xyz": [1.42, 0, 0]}}
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        change(server, "/machines", {"add": joint_machine})
        answer, = server.feed([{"machine": "excavator", "time": 0.0, "joints": START}])
        assert "error" not in answer, answer
        server.stop()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert server.json("/machines")["machines"][2]["state"]["joints"] == START


def test_a_hopper_that_comes_takes_soil_from_then_on(tmp_path):
    box = {"name": "truck", "box": [7.5, -2, 11, 2], "top": 1.0}
    path, out = scenario(tmp_path, SOIL), tmp_path / "out"
    first, second, third = (list(dump("digger", begin, y)) for begin, y in ((0, 0), (5, 0.9), (10, -0.9)))
    with Server(path, "--out", out, cwd=tmp_path) as server:
        take(server, first)
        assert figures(server)[1]["hauled"] == 0
        came = change(server, "/hoppers", {"add": box})["hoppers"]
        assert came[0]["name"] == "truck" and came[0]["time"][0] == round(first[-1]["time"], 6) and came[0]["time"][1] is None
        take(server, second)
        hauled = figures(server)[1]["hauled"]
        assert hauled > 0.01
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert figures(server)[1]["hauled"] == hauled
        assert figures(server, "?time=3")[1]["hauled"] == 0
        change(server, "/hoppers", {"rename": {"from": "truck", "to": "dumper"}})
        gone = change(server, "/hoppers", {"retire": "dumper"})["hoppers"]
        assert gone == [{"name": "dumper", "time": [came[0]["time"][0], second[-1]["time"]]}]
        # In its place another may come.
        change(server, "/hoppers", {"add": {**box, "name": "next", "box": [7.5, -2, 8, 2], "time": [100, 200]}})
        take(server, third)
        dug = figures(server)
        assert dug[1]["hauled"] == hauled and dug[2]["residual"] == 0
        report = server.get("/report.csv")[1]
        total = list(csv.DictReader(io.StringIO(report.decode())))[-1]
        assert float(total["hauled_m3_loose"]) == pytest.approx(hauled, rel=1e-6)
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert figures(server) == dug and server.get("/report.csv")[1] == report
    times = f"time: [{came[0]['time'][0]}, {second[-1]['time']}]"
    path.write_text(path.read_text() + f"hoppers:\n  - {{name: truck, box: [7.5, -2, 11, 2], top: 1.0, {times}}}\n")
    with Server(path, "--out", tmp_path / "always", cwd=tmp_path) as server:
        take(server, [*first, *second, *third])
        assert figures(server) == dug


BAD = [
    ("/machines", "", "not a JSON object"),
    ("/machines", "[1]", "not a JSON object"),
    ("/machines", {}, "a change is a JSON object with one key"),
    ("/machines", {"add": THIRD, "retire": "plate"}, "with one key"),
    ("/machines", {"add": THIRD, "place": 0}, "with one key"),
    ("/machines", {"sell": "plate"}, "one of the keys 'add', 'rename', 'retire' and 'restore'"),
    ("/machines", {"add": 1}, "machine is '1'; it must be a map with keys"),
    ("/machines", {"add": {**THIRD, "name": "plate"}}, "'plate' is the name of a machine; names must differ"),
    ("/machines", {"add": {**THIRD, "name": "a/b"}}, "name is 'a/b'"),
    ("/machines", {"add": {**THIRD, "buckets": 1}}, "unknown key 'buckets' in machine; did you mean 'bucket'?"),
    ("/machines", {"add": {**THIRD, "motion": "a.csv"}}, "unknown key 'motion' in machine"),
    ("/machines", {"add": {"name": "x", "bucket": {"width": -1, "height": 1}}}, "width"),
    ("/machines", {"add": {"name": "x"}}, "'bucket' is missing in machine"),
    ("/machines", {"add": {**THIRD, "urdf": "none.urdf"}}, "none.urdf"),
    ("/machines", '{"add": ' + "[" * 3000 + "]" * 3000 + "}", "JSON of few levels"),
    ("/machines", {"rename": {"from": "digger", "to": "plate"}}, "'plate' is the name of a machine"),
    ("/machines", {"rename": {"from": "digger"}}, "'rename' must be an object with 'from' and 'to'"),
    ("/machines", {"rename": {"from": "none", "to": "x"}}, "there is no machine 'none'; there are: 'digger' and 'plate'"),
    ("/machines", {"rename": {"from": "plate", "to": ""}}, "name is ''"),
    ("/machines", {"retire": "none"}, "there is no machine 'none'"),
    ("/machines", {"retire": ["plate"]}, "a machine must be a name"),
    ("/machines", {"restore": "plate"}, "machine 'plate' is not retired"),
    ("/machines?x=1", {"retire": "plate"}, "x"),
    ("/hoppers", {"add": {"name": "h", "box": [0, 0, 1, 1]}}, "'top' is missing in hopper"),
    ("/hoppers", {"add": {"name": "h", "box": [1, 0, 0, 1], "top": 1}}, "box goes from x 1 to x 0"),
    ("/hoppers", {"add": {"name": "h", "box": [0, 0, 1, 1], "top": 1, "time": [0.05, 9]}},
     "it must be later than all that was fed, 0.09"),
    ("/hoppers", {"add": {"name": "h", "box": [0, 0, 1, 1], "top": 1, "time": "now"}}, "'time' must be an array"),
    ("/hoppers", {"add": {"name": "h", "box": [0, 0, 1, 1], "top": 1, "time": [9, 8]}}, "gone later than it comes"),
    ("/hoppers", {"add": {"name": "digger", "box": [0, 0, 1, 1], "top": 1}}, "'digger' is the name of a machine"),
    ("/hoppers", {"add": {"name": "h", "box": [30.5, 0, 32, 1], "top": 1}}, "hopper 'h' overlaps hopper 'gone'"),
    ("/hoppers", {"retire": "none"}, "there is no hopper 'none'; there are: 'bin' and 'gone'"),
    ("/hoppers", {"retire": "bin", "time": 0}, "hopper 'bin' is gone already"),
    ("/hoppers", {"restore": "bin"}, "one of the keys 'add', 'rename' and 'retire'"),
]


def test_what_is_wrong_changes_nothing(tmp_path):
    path = scenario(tmp_path, SOIL + "hoppers:\n  - {name: bin, box: [20, 0, 21, 1], top: 1, time: [0, 0.05]}\n"
                    "  - {name: gone, box: [30, 0, 31, 1], top: 1}\n")
    (tmp_path / "looks").write_text("l00k")
    (tmp_path / "feeds").write_text("d1g")
    with Server(path, "--token-file", "feeds", "--view-token-file", "looks", "--out", tmp_path / "out",
                cwd=tmp_path) as server:
        fed = {"Authorization": "Bearer d1g"}
        assert server.post("/feed", list(passes("digger", 0.0, 0.2, 10)), fed)[0] == 200
        summary, journal = server.get("/summary.json", fed), (tmp_path / "out/journal").read_bytes()
        machines = json.loads(server.get("/machines", fed)[1])["machines"]
        for target, what, why in BAD:
            status, (answer,) = server.post(target, what if isinstance(what, str) else json.dumps(what), fed)
            assert status == 400 and why in answer["error"], (what, answer)
            assert "\n" not in answer["error"] and "site.yaml" not in answer["error"], answer
        for headers, status in (({}, 401), ({"Authorization": "Bearer l00k"}, 403)):
            assert server.post("/machines", json.dumps({"retire": "plate"}), headers)[0] == status
        assert json.loads(server.get("/summary.json", fed)[1])["state_hash"] == json.loads(summary[1])["state_hash"]
        now = json.loads(server.get("/machines", fed)[1])["machines"]
        assert [m["state"] for m in now] == [m["state"] for m in machines]
        assert (tmp_path / "out/journal").read_bytes() == journal
    with Server(scenario(tmp_path), "--out", tmp_path / "rigid", cwd=tmp_path) as server:
        status, (answer,) = server.post("/hoppers", '{"add": {"name": "h", "box": [0, 0, 1, 1], "top": 1}}')
        assert status == 400 and "hoppers are for a site with 'soil'" in answer["error"]
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "untimed", cwd=tmp_path) as server:
        take(server, [{**state, "time": None} for state in passes("digger", 0, 0.2, 5)])
        status, (answer,) = server.post("/hoppers", '{"add": {"name": "h", "box": [0, 0, 1, 1], "top": 1}}')
        assert status == 400 and "states without times were fed" in answer["error"]


@pytest.mark.parametrize("seed", range(3))
def test_any_order_of_changes_feeds_and_kills_ends_as_if_all_were_there_from_the_beginning(tmp_path, seed):
    rng, path, out = random.Random(seed), scenario(tmp_path, SOIL), tmp_path / "out"
    clock, fed, came, called = 0.0, [], [], {"digger": "digger", "plate": "plate"}
    server = Server(path, "--out", out, cwd=tmp_path)
    try:
        for _ in range(25):
            what = rng.choice(["add", "rename", "retire", "feed", "feed", "feed", "kill"])
            first = rng.choice(sorted(called))
            if what == "add" and len(called) < 6:
                name = f"m{len(came)}"
                came.append({**THIRD, "name": name})
                change(server, "/machines", {"add": came[-1]})
                called[name] = name
            elif what == "rename":
                to = f"n{rng.random()}"
                change(server, "/machines", {"rename": {"from": called[first], "to": to}})
                called[first] = to
            elif what == "retire":
                change(server, "/machines", {"retire": called[first]})
                change(server, "/machines", {"restore": called[first]})
            elif what == "feed":
                y = sorted(called).index(first) * 1.1
                for state in list(passes(first, y, 0.1 + 0.3 * rng.random(), 15))[:rng.randrange(2, 15)]:
                    clock += 0.2
                    fed.append({**state, "time": clock})
                    take(server, [{**fed[-1], "machine": called[first]}])
            elif what == "kill":
                server.kill()
                server.__exit__()
                server = Server(path, "--out", out, cwd=tmp_path)
        dug, there = figures(server), names(server)
        server.kill()
        server.__exit__()
        server = Server(path, "--out", out, cwd=tmp_path)
        assert figures(server) == dug and names(server) == there
    finally:
        server.__exit__()
    lines = "".join("  - " + json.dumps(machine) + "\n" for machine in came)
    path.write_text(path.read_text().replace("soil:", lines + "soil:"))
    with Server(path, "--out", tmp_path / "always", cwd=tmp_path) as server:
        take(server, fed)
        assert figures(server) == dug


def test_playback_goes_on_in_another_file(tmp_path):
    path, out = scenario(tmp_path, SOIL.replace("output: {", "output: {mcap: true, force: true, ")), tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        take(server, passes("digger", 0.0, 0.2, 20))
        change(server, "/machines", {"add": THIRD})
        take(server, passes("third", 2.0, 0.2, 20))
        server.stop()
    assert (out / "soil.mcap").stat().st_size > 1000
    for topic in (b"/load/third", b"/third/soil_wrench"):
        assert topic in (out / "soil_1.mcap").read_bytes()
