# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A live site: what is fed, asked, seen and kept."""
import asyncio
import csv
import json
import os
import socket
import subprocess
import threading
import time
import urllib.error
import urllib.request
import zlib
from pathlib import Path

import numpy as np
import pytest
import soilvdb
from live import PROGRAM, Server, passes, scenario, view, whole

SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\n"
LONG = "SOILVDB_LONG" in os.environ  # tools/test --long
FAST = "output: {snapshots: {every: 0.25}}\n"


def fed(path, until=float("inf")):
    """A site of a scenario that was fed the states up to a time."""
    site = soilvdb.Site.open(path)
    for state in states():
        if state["time"] > until:
            break
        site.update(state["machine"], time=state["time"], position=state["position"],
                    rotation=state["rotation"])
    return site


def states():
    return [*passes("digger", 0.0, 0.25, 60), *passes("plate", 4.0, 0.15, 60),
            *passes("digger", 0.4, 0.35, 60, begin=1.0)]


def test_a_feed_answers_as_a_site_of_the_same(tmp_path):
    path = scenario(tmp_path)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = server.feed(states())
        site = soilvdb.Site.open(path)
        for state, answer in zip(states(), answers):
            update = site.update(state["machine"], time=state["time"],
                                 position=state["position"], rotation=state["rotation"])
            assert answer["cut_m3"] == update.cut_m3
            assert answer["bucket_m3"] == update.bucket_m3
        summary = server.json("/summary.json")
        assert summary["volume_m3"]["cut"] > 1
        assert summary["volume_m3"]["residual"] == pytest.approx(0, abs=1e-9)
        assert summary["updates"] == len(states())
        places = np.random.default_rng(1).uniform([-1, -1], [5, 5], (50, 2))
        wanted = site.mesh_heights(places)
        for (x, y), height in zip(places, wanted):
            answer = server.json(f"/height?x={x!r}&y={y!r}")
            assert answer["height_m"] == pytest.approx(height, abs=1e-12)
            assert answer["before_m"] == pytest.approx(0.02 * x, abs=1e-12)
        line = server.json("/section?from=0.5,-1&to=3.5,3&points=200")
        along = np.linspace([0.5, -1], [3.5, 3], 200)
        assert np.allclose(line["now_m"], site.mesh_heights(along), atol=1e-9)
        assert np.allclose(line["before_m"], 0.02 * along[:, 0], atol=1e-9)
        assert line["distance_m"][-1] == pytest.approx(5)


def test_bad_lines_are_refused_and_change_nothing(tmp_path):
    good = json.dumps(next(passes("digger", 0.0, 0.3, 60)))
    bad = [("{", "not a JSON object: '{'"), ("[1]", "not a JSON object"), ("7", "not a JSON object"),
           ('{"machine": "diger", "time": 1}', "there is no machine 'diger'; there are: digger, plate"),
           ('{"time": 1}', "'machine' must name a machine"),
           ('{"machine": "digger", "tme": 1}', "unknown key 'tme'; there are 'machine', 'time', 'joints',"),
           ('{"machine": "digger", "time": 1}', "either 'joints' or 'position' and 'rotation'"),
           (good.replace("[0.0, 0.0, 0.0, 1.0]", "[0, 0, 0, 2]"), "its length is 2"),
           (good.replace("[0.0, 0.0, 0.0, 1.0]", "[0, 0, 1]"), "an array of 4 numbers"),
           (good.replace('"time": 0.0', '"time": "now"'), "'time' must be a number"),
           (good.replace('"time": 0.0', '"time": -1'), "time goes back"),
           (good.replace('"time": 0.0', '"time": 1763900000000'), "are these milliseconds?"),
           (good.replace('"time": 0.0', '"time": 9').replace("[0.0, 0.0, -0.3]", "[500.0, 0, 0]"),
            "are these metres?"),
           (good.replace('"time": 0.0', '"time": 1e999'), "not a JSON object"),
           (good.replace('"time": 0.0', '"time": NaN'), "JSON has no NaN"),
           ('{"machine": "digger", "time": 1, "joints": {"boom": 1}}', "has no joints"),
           ("[" * 20000, "not a JSON object"), ("\x00", "not a JSON object"), ("", "an empty message")]
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed([good, *list(passes("digger", 0.0, 0.3, 60))[1:30]])
        before = server.json("/summary.json")["state_hash"]
        for line, why in bad:
            answer, = server.feed([line])
            assert why in answer["error"], line
        assert server.json("/summary.json")["state_hash"] == before
        answers = server.feed([good.replace('"time": 0.0', '"time": 9')])
        assert "error" not in answers[0]


def test_what_cannot_be_asked_is_said(tmp_path):
    asked = {"/height?x=1": (400, "'y' is missing"), "/height?x=1&y=nan": (400, "'nan' is not"),
             "/height?x=1&y=1e300": (400, "is not"), "/height?x=1&x=2&y=3": (400, "can't be read"),
             "/height?x=1&y=2&z=3": (400, "unknown 'z'"),
             "/section?from=1,2&to=3": (400, "'to' must be x,y"),
             "/section?from=1,2&to=3,4&points=1": (400, "2 to 5000"),
             "/volume?boundary=1,2,3,4": (400, "3 to 1000 corners"),
             "/volume?boundary=0,0,1,0,1,1,0": (400, "3 to 1000 corners"),
             "/volume?boundary=" + ",".join(["1"] * 2002): (400, "3 to 1000 corners"),
             "/terrain?level=0&tile=99999,0": (404, "no such tile"),
             "/terrain?level=-1&tile=0,0": (404, "no such tile"),
             "/terrain?level=0&tile=0,0&surface=design": (400, "there is no design"),
             "/lines": (404, "there are no lines"),
             "/terrain?level=0&tile=0,0&surface=now": (400, "one of before, design"),
             "/surface.tif": (400, "nothing is dug yet"), "/mesh.glb": (400, "nothing is dug yet"),
             "/../../etc/passwd": (404, "no such page"), "/%2e%2e/etc/passwd": (404, "no such page"),
             "//etc/passwd": (404, "no such page"), "/%zz": (400, "can't be read"),
             "/view.js/../x": (404, "no such page"), "/index.html": (404, "no such page"),
             "/feed": (400, "/feed is a WebSocket"), "/scan": (400, "/scan is a WebSocket")}
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        for path, (status, why) in asked.items():
            got, body = server.get(path)
            assert (got, why in json.loads(body)["error"]) == (status, True), (path, body)


def test_the_page_comes_compressed_and_only_once(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        def ask(path, **headers):
            request = urllib.request.Request(server.url.rstrip("/") + path, headers={
                name.replace("_", "-"): value for name, value in headers.items()})
            try:
                with urllib.request.urlopen(request, timeout=60) as response:
                    return response.status, response.headers, response.read()
            except urllib.error.HTTPError as error:
                with error:
                    return error.code, error.headers, error.read()

        paths = [path for path in ("/", "/view.js", "/view.css") if server.get(path)[0] == 200]
        for path in paths:
            status, plain, body = ask(path)
            assert status == 200 and "Content-Encoding" not in plain
            if plain["ETag"] is None:   # the page was not built
                continue
            _, packed, small = ask(path, Accept_Encoding="gzip, deflate, br")
            assert packed["Content-Encoding"] == "deflate" and zlib.decompress(small) == body
            assert len(small) < 0.5 * len(body)
            assert packed["ETag"] == plain["ETag"] and packed["Cache-Control"] == "no-cache"
            status, headers, nothing = ask(path, If_None_Match=f'"x", {plain["ETag"]}')
            assert (status, nothing, headers["ETag"]) == (304, b"", plain["ETag"])
            assert ask(path, If_None_Match='W/"0"')[0] == 200
        _, live, _ = ask("/summary.json", Accept_Encoding="deflate")
        assert live["Cache-Control"] == "no-store" and live["ETag"] is None


def test_addresses_may_be_written_in_percent(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        plain = server.json("/height?x=-1.5&y=2")
        for target in ("/height?x=%2d1%2e5&y=2", "/height?%78=%2D1%2E5&y=2", "/%68eigh%74?x=-1.5&y=2"):
            assert server.json(target) == plain, target


def test_viewers_see_the_surface_that_there_is(tmp_path):
    path = scenario(tmp_path, SOIL)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        half = len(states()) // 2
        server.feed(states()[:half])
        last_s = states()[-1]["time"]

        newest, told = {}, 0

        def settled(texts, blocks):
            """Told of the end, and again seconds later, with no block in between."""
            nonlocal newest, told
            if newest != blocks:
                newest, told = dict(blocks), sum(t.get("time_s") == last_s for t in texts)
            return sum(t.get("time_s") == last_s for t in texts) > told + 2

        async def watch():
            rest = asyncio.get_running_loop().run_in_executor(None, feed_slowly)
            seen = await view(server, settled, seconds=300)
            await rest
            return seen

        def feed_slowly():
            for state in states()[half:]:
                server.feed([state])
                time.sleep(0.01)
        texts, blocks = asyncio.run(watch())
        fresh_texts, fresh = asyncio.run(view(server, whole()))
        site = fed(path)
    assert texts[0]["type"] == "site" and texts[0]["machines"][0]["name"] == "digger"
    # One who looked all the time has what one has who came in the end.
    for key, block in fresh.items():
        assert np.array_equal(blocks[key].lattice, block.lattice)
    points = np.concatenate([b.points for b in fresh.values()])
    change = np.concatenate([b.change for b in fresh.values() if len(b.points)])
    loose = np.concatenate([b.loose for b in fresh.values() if len(b.points)])
    wanted, _ = site.mesh()
    # The same surface, each vertex where the lattice of what is told is nearest to the mesh's.
    step = 0.05 / 256
    origin = np.array(fresh_texts[0]["origin"])
    lattice = {tuple(p) for b in fresh.values() for p in b.lattice}
    off = {tuple(p) for p in 4 * np.round((wanted - origin) / step).astype(int)} - lattice
    assert len(wanted) > 1000 and len(off) < 0.001 * len(wanted)  # halves, by rounding
    assert np.allclose(change, points[:, 2] - 0.02 * points[:, 0], atol=0.0007)  # a half millimetre, and of 1/256 voxel
    assert loose.max() > 0.5 and loose.min() == 0
    state = [t for t in fresh_texts if t["type"] == "state"][-1]
    assert state["machines"][0]["position"] == states()[-1]["position"]
    assert any(t["type"] == "state" and t["machines"][0]["state"] == "working" for t in texts)


def test_borders_are_shared_to_the_bit(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(states())
        _, blocks = asyncio.run(view(server, whole()))
    edges = {}
    for block in blocks.values():
        if not len(block.lattice):
            continue
        for triangle in block.triangles:
            corners = [tuple(block.lattice[i]) for i in triangle]
            for a, b in zip(corners, corners[1:] + corners[:1]):
                edges[a, b] = edges.get((a, b), 0) + 1
    resident = {(b.block[0] // 8 + n // 16, b.block[1] // 8 + n // 4 % 4, b.block[2] // 8 + n % 4)
                for b in blocks.values() for n in range(64) if b.resident >> n & 1}
    open_edges = [a for a, b in edges if (b, a) not in edges and a != b]
    # Only where the resident ground ends, at a chunk's side: half a voxel from a multiple of eight.
    assert len(blocks) > 4 and resident
    for place in open_edges:
        assert max(abs((c + 512) % 8192 - 4096) for c in place) > 4096 - 1024, place


def test_a_killed_server_goes_on_at_what_it_acknowledged(tmp_path):
    path = scenario(tmp_path, SOIL + FAST)
    known = 0
    all_states = states()
    rng = np.random.default_rng(3)
    while known < len(all_states):
        with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
            there = server.json("/summary.json")["updates"]
            assert there >= known, "what was acknowledged is there"
            server.feed(all_states[there:there + int(rng.integers(*((10, 60) if LONG else (50, 90))))])
            time.sleep(rng.uniform(0, 1.5))
            known = server.json("/summary.json")["acknowledged"]["updates"]
            server.kill()
    with Server(path, "--out", tmp_path / "once", cwd=tmp_path) as server:
        server.feed(all_states)
        once = server.json("/summary.json")
        server.stop()
    with Server(path, "--out", tmp_path / "once", cwd=tmp_path) as server:
        durations = server.json("/summary.json")["update_us"]
        assert durations == pytest.approx(once["update_us"], rel=0.02)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        again = server.json("/summary.json")
        for key in ("state_hash", "volume_m3", "mass_kg"):
            assert again[key] == once[key]
        text = server.stop()
        assert "180 states, to 1.59 s" in text, text


def test_volumes_inside_boundaries_are_those_of_diff(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        (tmp_path / "a.vdb").write_bytes(server.get("/soil.vdb")[1])
        server.feed(states())
        (tmp_path / "b.vdb").write_bytes(server.get("/soil.vdb")[1])
        diff = json.loads(subprocess.run(
            [PROGRAM, "diff", tmp_path / "a.vdb", tmp_path / "b.vdb", "--json"],
            capture_output=True, check=True).stdout)
        whole_site = server.json("/volume?boundary=-20,-20,20,-20,20,20,-20,20")
        for key in ("cut_m3", "fill_m3", "net_m3"):
            assert whole_site[key] == diff[key]
        assert whole_site["area_m2"] == pytest.approx(1600)
        # Parts that share an edge, which goes across cells, add up; either way round.
        left = server.json("/volume?boundary=-20,-20,1.234,-20,2.71,20,-20,20")
        right = server.json("/volume?boundary=20,20,2.71,20,1.234,-20,20,-20")
        for key in ("cut_m3", "fill_m3"):
            assert left[key] > 0 and right[key] > 0
            assert left[key] + right[key] == pytest.approx(diff[key], abs=1e-12)
        # Of a pass that is as wide as the mouth, away from where it begins and ends.
        part = server.json("/volume?boundary=1,3.6,3,3.6,3,4.4,1,4.4")
        assert part["net_m3"] == pytest.approx(-2 * 0.8 * 0.15, rel=0.01)


def told_of(state):
    """What a state says that a site can say, too."""
    return (state["time_s"], state["cut_m3"],
            [(m["position"], m["bucket_m3"], m["cut_m3"]) for m in state["machines"]])


def told_by(path, until):
    """The same, of a site that was fed up to a time."""
    site, there = fed(path, until), [s for s in states() if s["time"] <= until]
    machines = []
    for name in site.machines:
        last = [s["position"] for s in there if s["machine"] == name][-1:]
        ledger = site.ledger(name)
        machines.append((*(last or [None]), ledger["bucket_m3"], ledger["cut_m3"]))
    return max(s["time"] for s in there), site.ledger()["cut_m3"], machines


def test_times_are_shown_as_they_were(tmp_path):
    path = scenario(tmp_path, SOIL + FAST)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(states())
        while server.json("/summary.json")["acknowledged"]["updates"] < len(states()):
            time.sleep(0.1)

        def at(time_s):
            return fed(path, time_s)
        for time_s in (0.3, 0.55, 1.2, 1.59):
            summary = server.json(f"/summary.json?time={time_s}")
            assert summary["state_hash"] == f"{at(time_s).ground_hash():016x}"
        for later in ("time=99", "time=1&against=1.6"):
            status, body = server.get(f"/height?x=0&y=0&{later}")
            assert status == 400 and "s is later than what is recorded, which goes up to 1.59 s" in (
                json.loads(body)["error"])
        texts, _ = asyncio.run(view(server, whole(1), [{"time": 99}, {"time": 0.3}]))
        assert "is later than" in next(t["error"] for t in texts if t["type"] == "error")
        along = np.linspace([2, -1], [2, 3], 100)
        line = server.json("/section?from=2,-1&to=2,3&points=100&time=1.2&against=0.3")
        assert np.allclose(line["now_m"], at(1.2).mesh_heights(along), atol=1e-9)
        assert np.allclose(line["before_m"], at(0.3).mesh_heights(along), atol=1e-9)
        texts, blocks = asyncio.run(view(server, whole(1), [{"time": 1.2, "against": 0.3}]))
        shown = [b for (id, _), b in blocks.items() if id == 1 and len(b.points)]
        assert texts[-1]["blocks"] == sum(id == 1 for id, _ in blocks)
        # So are its machines, their loads and what they did.
        told, = [t["state"] for t in texts if t["type"] == "view"]
        assert told_of(told) == told_by(path, 1.2)
        rows = server.get("/machines.csv?time=1.2")[1].decode().splitlines()
        assert float(rows[1].split(",")[7]) == fed(path, 1.2).ledger("digger")["cut_m3"]
        points = np.concatenate([b.points for b in shown])
        before = at(0.3).mesh_heights(points[:, :2])
        flat = np.isfinite(before)
        change = np.concatenate([b.change for b in shown])
        off = np.abs(change - (points[:, 2] - before))[flat]
        assert np.mean(off < 0.0006) > 0.99  # else at walls, whose places are rounded
        # Where it was as in the beginning and no more is, each vertex has changed, to the last.
        level = 0.02 * points[:, 0]
        dug = flat & (np.abs(before - level) < 0.001) & (np.abs(points[:, 2] - level) > 0.01)
        dug &= points[:, 1] > 0.65
        assert dug.sum() > 1000 and (change[dug] != 0).all()
        # Against itself nothing has changed, steep walls neither.
        for time_s in (0.3, 1.2):
            _, blocks = asyncio.run(view(server, whole(1), [{"time": time_s, "against": time_s}]))
            shown = [b for (id, _), b in blocks.items() if id == 1 and len(b.points)]
            assert shown and all((b.change == 0).all() for b in shown)
        texts, _ = asyncio.run(view(
            server, lambda texts, _: texts and texts[-1]["type"] == "error",
            [{"time": 0.2, "against": 0.3}]))
        assert texts[-1]["error"] == "compare with an earlier time"
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        summary = server.json("/summary.json")
        assert summary["volume_m3"]["residual"] == pytest.approx(0, abs=1e-9)
        texts, _ = asyncio.run(view(server, whole()))
        assert told_of(texts[1]) == told_by(path, 99.0)
        assert texts[0]["live"] is False
        assert texts[0]["times"]["to"] == pytest.approx(states()[-1]["time"])
        assert texts[0]["times"]["snapshots"]  # as many as could be written meanwhile
        answer, = server.feed(["{}"])
        assert "can only be viewed" in answer["error"]
        assert server.json("/summary.json?time=1.2")["volume_m3"] != summary["volume_m3"]


def test_a_finished_run_is_looked_at(tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text("soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0.0}}\nmachines:\n"
                    "  - {name: m, bucket: {width: 1.0, height: 0.8}, motion: m.csv}\n"
                    "output: {snapshots: {every: 1}}\n")
    (tmp_path / "m.csv").write_text("time,x,y,z,qx,qy,qz,qw\n" + "".join(
        f"{i / 10},{i / 10},0,-0.2,0,0,0,1\n" for i in range(41)))
    subprocess.run([PROGRAM, "run", path, "--out", tmp_path / "out"], check=True,
                   capture_output=True)
    run = json.loads((tmp_path / "out/summary.json").read_text())
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        summary = server.json("/summary.json")
        for key in ("state_hash", "volume_m3"):
            assert summary[key] == run[key]
        texts, _ = asyncio.run(view(server, whole()))
        assert texts[0]["times"]["snapshots"] == [1, 2, 3, 4]
        assert texts[1]["machines"][0]["position"] == [4.0, 0, -0.2]
        assert texts[1]["machines"][0]["cut_m3"] == run["volume_m3"]["cut"]
        row, = csv.DictReader(server.get("/machines.csv")[1].decode().splitlines())
        assert [float(row[key]) for key in ("x_m", "y_m", "z_m")] == [4, 0, -0.2]
        assert float(row["bucket_m3"]) == texts[1]["machines"][0]["bucket_m3"]
        # Also between snapshots it is the newest that isn't later: the row of 2.3 s.
        first = server.json("/volume?boundary=-9,-9,9,-9,9,9,-9,9&time=2.35")
        assert first["net_m3"] == pytest.approx(-2.3 * 0.2, rel=0.01)
        texts, _ = asyncio.run(view(server, whole(1), [{"time": 2.35}]))
        told, = [t["state"] for t in texts if t["type"] == "view"]
        assert (told["time_s"], told["machines"][0]["position"]) == (2.3, [2.3, 0, -0.2])
        assert told["cut_m3"] == pytest.approx(-first["net_m3"], abs=1e-12)
        assert told["change_m3"] == pytest.approx(first["net_m3"], abs=1e-12)
        past = server.json("/summary.json?time=2.35")
        assert past["volume_m3"]["cut"] == told["cut_m3"]
    listed = subprocess.run([PROGRAM, "serve", tmp_path], capture_output=True, text=True)
    assert listed.returncode == 2 and "neither a scenario nor the folder" in listed.stderr


def test_a_run_of_moving_soil_and_joints_is_looked_at_at_any_time(tmp_path):
    """The excavator of the demonstrations, which digs, dumps and slides soil."""
    path = Path(__file__).parents[2] / "data/excavator.yaml"
    folders = []
    for more in ([], ["--updates", "300"]):
        folders.append(tmp_path / f"out{len(folders)}")
        subprocess.run([PROGRAM, "run", path, "--out", folders[-1], "--no-mesh", *more],
                       check=True, capture_output=True)
    for folder in folders:
        run = json.loads((folder / "summary.json").read_text())
        updates = [line.split(",") for line in (folder / "updates.csv").read_text().split()[1:]]
        with Server(folder, cwd=tmp_path) as server:
            summary = server.json("/summary.json")
            for key in ("state_hash", "volume_m3", "mass_kg"):
                assert summary[key] == run[key]
            texts, _ = asyncio.run(view(server, whole()))
            times = texts[0]["times"]
            for share in (0.3, 0.77):
                time_s = times["from"] + share * (times["to"] - times["from"])
                texts, _ = asyncio.run(view(
                    server, lambda texts, _: texts and texts[-1]["type"] == "view",
                    [{"time": time_s}]))
                told = texts[-1]["state"]
                before = [u for u in updates if float(u[0]) <= time_s]
                assert told["time_s"] == pytest.approx(float(before[-1][0]), abs=1e-6)
                assert told["cut_m3"] == pytest.approx(sum(float(u[2]) for u in before), rel=1e-6)
                assert told["machines"][0]["links"] and told["machines"][0]["cycles"] > 0
                past = server.json(f"/summary.json?time={time_s}")
                assert past["mass_kg"]["residual"] == 0
                assert 0 < told["fill_m3"] == pytest.approx(past["volume_m3"]["fill"], abs=1e-9)
                assert past["volume_m3"]["ground_change"] == pytest.approx(told["change_m3"],
                                                                           abs=1e-9)


def test_who_stands_for_ten_seconds_is_idle_in_the_past_too(tmp_path):
    def way(y, until):
        return [(t, [min(t, until), y, 1.0]) for t in range(31)]
    path = scenario(tmp_path)
    with Server(path, "--out", tmp_path / "fed", cwd=tmp_path) as server:
        answers = server.feed({"machine": machine, "time": t, "position": at,
                               "rotation": [0.0, 0.0, 0.0, 1.0]}
                              for both in zip(way(0.0, 4), way(4.0, 12))
                              for machine, (t, at) in zip(("digger", "plate"), both))
        assert not [a for a in answers if "error" in a]
        server.stop()
    text = path.read_text()
    for name, y, until in (("digger", 0.0, 4), ("plate", 4.0, 12)):
        (tmp_path / f"{name}.csv").write_text("time,x,y,z\n" + "".join(
            f"{t},{x},{y},{z}\n" for t, (x, y, z) in way(y, until)))
        text = text.replace(f"- name: {name}\n", f"- name: {name}\n    motion: {name}.csv\n")
    path.write_text(text)
    subprocess.run([PROGRAM, "run", path, "--out", tmp_path / "run"], check=True,
                   capture_output=True)
    for folder in ("fed", "run"):
        with Server(tmp_path / folder, cwd=tmp_path) as server:
            for time_s, wanted in ((3, ["working", "working"]), (13, ["working", "working"]),
                                   (15, ["idle", "working"]), (30, ["idle", "idle"])):
                rows = server.get(f"/machines.csv?time={time_s}")[1].decode().splitlines()
                assert [row["state"] for row in csv.DictReader(rows)] == wanted, (folder, time_s)


def test_a_machine_that_lags_takes_no_time_back(tmp_path):
    path = scenario(tmp_path)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed([*passes("digger", 0.0, 0.25, 60), *passes("plate", 4.0, 0.15, 20)])
        live, _ = asyncio.run(view(server, whole()))
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        past, _ = asyncio.run(view(server, whole()))
        assert past[0]["times"]["to"] == 0.59
    for texts in (live, past):
        assert [t["time_s"] for t in texts if t["type"] == "state"][-1] == 0.59


def test_ground_that_was_dug_before_is_none_of_what_a_site_digs(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "before", cwd=tmp_path) as server:
        server.feed(states())
        (tmp_path / "before.vdb").write_bytes(server.get("/soil.vdb")[1])
    path = scenario(tmp_path, SOIL)
    path.write_text(path.read_text().replace("{plane: {z: 0.0, slope: [0.02, 0.0]}}",
                                             "{level_set: before.vdb}"))
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(passes("digger", 2.0, 0.2, 60))
        summary = server.json("/summary.json")
        assert summary["volume_m3"]["cut"] > 0.1
        assert summary["volume_m3"]["residual"] == pytest.approx(0, abs=1e-9)
        assert summary["mass_kg"]["residual"] == 0


def test_what_remains_to_a_design_is_told(tmp_path):
    """A design that is 0.3 m below the ground, and a trench that goes 0.2 m below the design."""
    row = " ".join(f"{-0.5 + 0.01 * i:.2f}" for i in range(41))
    (tmp_path / "plan.asc").write_text(
        "ncols 41\nnrows 41\nxllcenter -10\nyllcenter -10\ncellsize 0.5\n" + f"{row}\n" * 41)
    with Server(scenario(tmp_path), "--design", tmp_path / "plan.asc", "--out", tmp_path / "out",
                cwd=tmp_path) as server:
        server.feed(passes("digger", 0.0, 0.5, 60))
        away = server.json("/volume?boundary=1,2,3,2,3,4,1,4")
        assert away["to_cut_m3"] == pytest.approx(2 * 2 * 0.3, rel=0.03)
        assert (away["to_fill_m3"], away["net_m3"]) == (0, 0)
        within = server.json("/volume?boundary=1,-0.4,3,-0.4,3,0.4,1,0.4")
        assert within["to_fill_m3"] == pytest.approx(2 * 0.8 * 0.2, rel=0.03)
        assert within["to_cut_m3"] == 0
        _, blocks = asyncio.run(view(server, whole()))
        seen = [b for b in blocks.values() if len(b.points)]
        points = np.concatenate([b.points for b in seen])
        above = np.concatenate([b.design for b in seen])
        assert np.allclose(above, points[:, 2] - (-0.3 + 0.02 * points[:, 0]), atol=0.0007)  # a half millimetre, and of 1/256 voxel
        assert above.min() < -0.19


def test_motions_are_played_where_they_are_between_rows_and_went_before(tmp_path):
    """A machine turns slowly: each state shown is as far round as its time says."""
    data = Path(__file__).parents[2] / "data"
    text = (data / "excavator.yaml").read_text().replace("excavator.csv", "turn.csv")
    for name in ("hills.tif", "excavator.urdf"):
        text = text.replace(name, str(data / name))
    path = tmp_path / "turn.yaml"
    path.write_text(text)
    pose = {"boom_joint": 0.3, "arm_joint": -0.92, "bucket_joint": -0.54}
    (tmp_path / "turn.csv").write_text(
        "time,swing_joint," + ",".join(pose) + "\n" + "".join(
            f"{t},{swing}," + ",".join(map(str, pose.values())) + "\n"
            for t, swing in ((0, 0), (3600, 1.8))))
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answer, = server.feed([{"machine": "excavator", "time": 3000,
                                "joints": {"swing_joint": 1.5, **pose}}])
        assert "error" not in answer
        server.stop()
    with Server(path, "--speed", "20", "--out", tmp_path / "out", cwd=tmp_path) as server:
        def far(texts, _):
            return texts and (texts[-1].get("time_s") or 0) >= 3060
        texts, _ = asyncio.run(view(server, far, seconds=30))
    shown = [(t["time_s"], np.array(t["machines"][0]["rotation"])) for t in texts
             if t["type"] == "state"]
    (begin, first), *rest = shown
    assert len({t for t, _ in rest}) > 5 and begin >= 3000
    for time_s, q in rest:
        half = np.linalg.norm(first[3] * q[:3] - q[3] * first[:3] - np.cross(first[:3], q[:3]))
        assert 2 * np.arcsin(half) == pytest.approx(1.8 * (time_s - begin) / 3600, abs=1e-7)


def test_folders_that_are_not_kept_are_removed(tmp_path):
    """That of a file lasts as long as its request, that of a played site as long as the site."""
    temp = tmp_path / "temp"
    temp.mkdir()
    data = Path(__file__).parents[2] / "data"
    with Server(data / "half_sine.yaml", "--speed", "20", cwd=tmp_path, env={"TMPDIR": str(temp)}) as server:
        while server.json("/summary.json")["volume_m3"]["cut"] == 0:
            pass
        assert server.get("/mesh.glb")[1][:4] == b"glTF"
        recording, = temp.iterdir()
        assert (recording / "journal").exists()
        server.stop()
    assert not list(temp.iterdir())


def test_a_design_is_told_on_the_posts_of_the_terrain(tmp_path):
    posts = 41
    row = " ".join(f"{-0.5 + 0.01 * i:.2f}" for i in range(posts))
    (tmp_path / "plan.asc").write_text(
        f"ncols {posts}\nnrows {posts}\nxllcenter -10\nyllcenter -10\ncellsize 0.5\n"
        + f"{row}\n" * posts)
    with Server(scenario(tmp_path), "--design", tmp_path / "plan.asc", "--out", tmp_path / "out",
                cwd=tmp_path) as server:
        texts, _ = asyncio.run(view(server, whole()))
        terrain = texts[0]["terrain"]
        level, low = terrain["levels"][-1], np.array(terrain["bounds"][:2])
        last = len(terrain["levels"]) - 1
        design, ground = (np.frombuffer(server.get(
            f"/terrain?level={last}&tile=0,0{more}")[1], "<f4").reshape(level["ny"], level["nx"])
            for more in ("&surface=design", ""))
        known = 0
        for j in range(0, level["ny"], 7):
            for i in range(0, level["nx"], 7):
                x, y = low + level["spacing_m"] * np.array([i, j])
                asked = server.json(f"/height?x={x}&y={y}")
                assert ground[j, i] == pytest.approx(asked["height_m"], abs=1e-5)
                inside = max(abs(x), abs(y)) <= 10
                assert np.isnan(design[j, i]) == (asked["design_m"] is None) == (not inside)
                if inside:
                    assert design[j, i] == pytest.approx(-0.5 + 0.01 * (x + 10) / 0.5, abs=1e-5)
                    known += 1
        assert known > 10


def write_flat(path, first, crs=""):
    """A raster of 20 m x 20 m from x = y = `first` on."""
    path.write_text(f"ncols 21\nnrows 21\nxllcenter {first}\nyllcenter {first}\ncellsize 1\n"
                    + ("0 " * 21 + "\n") * 21)
    return path


def test_a_design_that_lies_elsewhere_is_warned_of(tmp_path):
    write_flat(tmp_path / "hills.asc", 100)
    path = scenario(tmp_path)
    path.write_text(path.read_text().replace("{plane: {z: 0.0, slope: [0.02, 0.0]}}",
                                             "{raster: hills.asc}"))
    for first, warns in ((115, False), (1000, True)):
        plan = write_flat(tmp_path / f"{first}.asc", first)
        with Server(path, "--design", plan, "--out", tmp_path / "out", cwd=tmp_path) as server:
            said = server.stop()
        assert (f"the design {plan} doesn't overlap the terrain: it goes from 1000, 1000 to 1020, 1020, "
                "and the terrain from 100, 100 to 120, 120" in " ".join(said.split())) == warns, said


def test_a_start_that_fails_leaves_nothing(tmp_path):
    path = scenario(tmp_path)
    with Server(path, "--out", tmp_path / "other", cwd=tmp_path) as server:
        port = server.url.rstrip("/").rpartition(":")[2]
        for more, why in ((["--port", port], "can't listen on 127.0.0.1 port " + port),
                          (["--design", "nothere.tif"], "nothere.tif"), (["--speed", "1"], "--speed")):
            refused = subprocess.run([PROGRAM, "serve", path, "--out", "out", *more], cwd=tmp_path,
                                     capture_output=True, text=True, timeout=60)
            assert refused.returncode == 2 and why in refused.stderr, refused
            assert not (tmp_path / "out").exists()


def test_what_is_recorded_beside_is_known(tmp_path):
    path = scenario(tmp_path, "output: {mcap: true}\n")
    for part in range(2):
        with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
            server.feed(list(passes("digger", 2.0 * part, 0.2, 20, begin=10.0 * part)))
            said = server.stop()
        assert (f"{tmp_path}/out: begins here" in said) == (part == 0)
    done = subprocess.run([PROGRAM, "verify", tmp_path / "out"], capture_output=True, text=True,
                          timeout=60)
    assert done.returncode == 0
    for name in ("soil.mcap", "soil_1.mcap"):
        assert f"{name:<20} is beside the recording\n" in done.stdout


def test_cycles_are_those_of_loads(tmp_path):
    """A load is at least a quarter of what the bucket holds, and ends when most of it is gone."""
    def load_and_tip(y, curl, depth, begin, tips):
        back = [0.0, float(-np.sin(curl / 2)), 0.0, float(np.cos(curl / 2))]
        way = [{**state, "rotation": back} for state in passes("digger", y, depth, 60, begin)]
        x = way[-1]["position"][0]
        up = [{"machine": "digger", "time": begin + 1 + 0.1 * i, "position": [x, y, 0.1 * i],
               "rotation": back} for i in range(20)]
        tipped = [{"machine": "digger", "time": begin + 4 + 0.1 * i, "position": [x, y, 1.9],
                   "rotation": [0.0, float(np.sin(i / 40)), 0.0, float(np.cos(i / 40))]}
                  for i in range(tips)]
        return [*way, *up, *tipped]

    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        # A scrape fills little of a bucket.
        for n, (curl, depth, cycles) in enumerate(((0.5, 0.2, 1), (0.0, 0.01, 1), (0.5, 0.2, 2))):
            answers = server.feed(load_and_tip(3.0 * n, curl, depth, 20.0 * n, 60))
            loads = [answer["bucket_m3"] for answer in answers]
            _, body = server.get("/machines.csv")
            row = dict(zip(*(line.split(",") for line in body.decode().splitlines()[:2])))
            assert int(row["cycles"]) == cycles, row
            assert (max(loads) > 0.15) == (curl > 0)
            if curl > 0:
                assert float(row["last_load_m3"]) == max(loads)


def test_standard_input_feeds_too(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "over", cwd=tmp_path) as server:
        wanted = server.feed(states())
    lines = "".join(json.dumps(state) + "\n" for state in states()) + "{}\n"
    process = subprocess.Popen([PROGRAM, "serve", scenario(tmp_path), "--out", tmp_path / "in",
                                "--port", "0", "--stdin"], cwd=tmp_path, text=True,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE)
    writer = threading.Thread(target=lambda: (process.stdin.write(lines), process.stdin.flush()))
    writer.start()
    answers = [json.loads(process.stdout.readline()) for _ in range(len(states()) + 1)]
    writer.join()
    process.terminate()
    process.communicate(timeout=30)
    assert process.returncode == 0
    assert "error" in answers[-1]
    for answer, other in zip(answers, wanted):
        assert answer["cut_m3"] == other["cut_m3"]


def test_only_who_knows_the_token_and_no_page_from_elsewhere(tmp_path):
    path = scenario(tmp_path)
    refused = subprocess.run([PROGRAM, "serve", path, "--listen", "0.0.0.0", "--port", "0"],
                             capture_output=True, text=True)
    assert refused.returncode == 2 and "give a --token-file" in refused.stderr
    assert not (tmp_path / "out").exists()
    with Server(path, "--out", tmp_path / "a", "--token", "s3cret", cwd=tmp_path) as server:
        assert server.get("/")[0] == 200
        for target in ("/height?x=0&y=0", "/summary.json", "/height?x=0&y=0&token=s3cre",
                       "/height?x=0&y=0&token=s3cret2", "/nowhere"):
            assert server.get(target)[0] == 401, target
        assert server.get("/height?x=0&y=0&token=s3cret")[0] == 200
        assert server.get("/height?x=0&y=0", {"Authorization": "Bearer s3cret"})[0] == 200
        assert server.get("/height?x=0&y=0", {"Authorization": "Bearer "})[0] == 401
        with pytest.raises(Exception, match="401"):
            server.feed(["{}"])
    with Server(path, "--out", tmp_path / "b", cwd=tmp_path) as server:
        assert server.get("/height?x=0&y=0", {"Origin": "http://evil.example"})[0] == 403
        assert server.get("/height?x=0&y=0", {"Host": "evil.example"})[0] == 403
        assert server.get("/height?x=0&y=0", {"Origin": server.url.rstrip("/")})[0] == 200

        async def from_elsewhere():
            async with server.connect("/feed", origin="http://evil.example"):
                pass
        with pytest.raises(Exception, match="403"):
            asyncio.run(from_elsewhere())


def test_messages_that_are_too_large_or_malformed_end_only_their_connection(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        host, port = server.url.split("/")[2].split(":")

        async def large():
            async with server.connect("/feed") as feed:
                await feed.send("x" * 70_000)
                await feed.recv()
        with pytest.raises(Exception):
            asyncio.run(large())
        rng = np.random.default_rng(5)
        for bytes_ in (b"\x00" * 100, b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 5000,
                       b"GET " + b"/" * 20000, b"POST / HTTP/1.1\r\nHost: localhost\r\n"
                       b"Content-Length: 1000000\r\n\r\n", *(rng.bytes(200) for _ in range(20))):
            with socket.create_connection((host, int(port)), 5) as raw:
                raw.settimeout(5)
                try:
                    raw.sendall(bytes_)
                    raw.shutdown(socket.SHUT_WR)
                    while raw.recv(4096):
                        pass
                except OSError:  # it may have gone already
                    pass
        assert "error" not in server.feed([next(passes("digger", 0.0, 0.3, 60))])[0]
