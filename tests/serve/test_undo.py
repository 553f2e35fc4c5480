# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Bad states of a machine that are taken back."""
import asyncio
import json
import random
import subprocess
import threading
import time

import pytest
from live import PROGRAM, Block, Server, passes, scenario, view, whole
from test_newcomers import THIRD, change, figures, names, take

THREE = "  - " + json.dumps(THIRD) + "\n"
SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\n"
OUTPUT = "output: {snapshots: {every: 1.5, %s}, journal: {sync: always}}\n"
HOPPERS = "hoppers:\n  - {name: truck, box: [3.5, -1, 9, 2], top: 0.2}\n"
ALL = ("digger", "plate", "third")


def work(seed, states=150):
    """Passes of three machines in random turns, over each other's ground, some without times."""
    rng, clock = random.Random(seed), 0.0
    ways = {name: [] for name in ALL}
    all_states = []
    while len(all_states) < states:
        name = rng.choice(ALL)
        if not ways[name]:
            ways[name] = list(passes(name, 0.6 * ALL.index(name) + rng.uniform(-0.3, 0.3), rng.uniform(0.05, 0.5), 25))
            for i, state in enumerate(ways[name]):  # back through the air
                if i == 0:
                    state["position"][2] = 1.5
        clock += rng.uniform(0.05, 0.2)
        for _ in range(rng.randrange(1, 4)):
            if ways[name]:
                clock += 0.1
                all_states.append({**ways[name].pop(0), "time": clock})
    return all_states


def undo(server, machine, time_s, method="POST"):
    status, body = server.get(f"/undo?machine={machine}&time={time_s}", method=method)
    return status, json.loads(body)


def stays(states, machine, time_s):
    return [state for state in states if state["machine"] != machine or state["time"] <= time_s]


@pytest.mark.parametrize("seed, more", [
    (0, SOIL + OUTPUT % "incremental: true"), (1, SOIL + OUTPUT % "keep: 2" + HOPPERS),
    (2, OUTPUT % "incremental: true, keep: 2"), (3, SOIL + HOPPERS + "output: {snapshots: {every: 1000}, journal: {sync: always}}\n")])
def test_ground_and_balance_are_those_of_a_site_that_was_never_fed_what_was_taken_back(tmp_path, seed, more):
    rng, path, out = random.Random(seed), scenario(tmp_path, THREE + more), tmp_path / "out"
    all_states, done = work(seed), 0
    fed = []
    server = Server(path, "--out", out, cwd=tmp_path)
    try:
        for cut in (90, 120, 150):
            take(server, all_states[done:cut])
            fed += all_states[done:cut]
            done = cut
            machine = rng.choice(ALL)
            time_s = rng.choice(fed)["time"] - rng.choice([0, 0.01])
            left = stays(fed, machine, time_s)
            before, count = figures(server), len(fed)
            status, told = undo(server, machine, time_s, "GET")
            assert status == 200 and told["states"] == count - len(left) and told["about_s"] >= 0, told
            assert figures(server) == before, "nothing has changed"
            status, made = undo(server, machine, time_s)
            assert status == 200 and [made[key] for key in ("machine", "time_s", "states", "others")] == [
                told[key] for key in ("machine", "time_s", "states", "others")], made
            assert 0 <= made["took_s"] and undo(server, machine, time_s, "GET")[1]["states"] == 0
            fed = left
            now, early = figures(server), figures(server, f"?time={fed[len(fed) // 2]['time']}")
            with Server(path, "--out", tmp_path / f"never{cut}", cwd=tmp_path) as other:
                take(other, fed)
                assert figures(other) == now, (machine, time_s)
                assert figures(other, f"?time={fed[len(fed) // 2]['time']}") == early
                same = [[m["state"], m["bucket_m3"]] for m in other.json("/machines")["machines"]]
                report = other.get("/report.csv")[1]
            assert [[m["state"], m["bucket_m3"]] for m in server.json("/machines")["machines"]] == same
            assert server.get("/report.csv")[1] == report
            kill = rng.random() < 0.5
            server.kill() if kill else server.stop()
            server.__exit__()
            server = Server(path, "--out", out, cwd=tmp_path)
            assert figures(server) == now and figures(server, f"?time={fed[len(fed) // 2]['time']}") == early
            assert server.get("/report.csv")[1] == report
            checked = subprocess.run([PROGRAM, "verify", out], capture_output=True, text=True, timeout=60)
            assert checked.returncode == 0, checked
        server.stop()
    finally:
        server.__exit__()


def test_a_kill_at_any_time_leaves_the_ground_before_or_after(tmp_path):
    rng, path = random.Random(7), scenario(tmp_path, THREE + SOIL + OUTPUT % "incremental: true")
    all_states = work(7, 120)
    machine, time_s = "digger", all_states[20]["time"]
    with Server(path, "--out", tmp_path / "never", cwd=tmp_path) as server:
        take(server, stays(all_states, machine, time_s))
        after = figures(server)
    out = tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        take(server, all_states)
        before = figures(server)
        server.stop()
    good = {file.name: file.read_bytes() for file in out.iterdir()}
    seen, longest = set(), 1.0
    for i in range(12):
        for file in out.iterdir():
            file.unlink()
        for name, content in good.items():
            (out / name).write_bytes(content)
        with Server(path, "--out", out, cwd=tmp_path) as server:
            assert figures(server) == before
            thread = threading.Thread(target=lambda: seen.add(_quiet(server, machine, time_s)))
            begin = time.monotonic()
            thread.start()
            if i == 0:
                thread.join()
                longest = time.monotonic() - begin
            else:
                time.sleep(rng.uniform(0, 1.2 * longest))
            server.kill()
            thread.join()
        with Server(path, "--out", out, cwd=tmp_path) as server:
            now = figures(server)
            assert now in (before, after)
            assert not list(out.glob(".journal*")), "nothing is left over"
            seen.add(now == after)
            server.kill()
    assert True in seen


def _quiet(server, machine, time_s):
    try:
        return undo(server, machine, time_s)[0]
    except OSError:
        return 0


def test_viewers_and_queries_have_the_new_ground(tmp_path):
    path = scenario(tmp_path, SOIL + OUTPUT % "incremental: true")
    deep, flat = list(passes("digger", 0.0, 0.5, 60)), list(passes("plate", 3.0, 0.2, 60))

    def shapes(blocks):
        return {block: b.points.tobytes() for block, b in blocks.items() if len(b.points)}

    async def work(server):
        loop, blocks = asyncio.get_running_loop(), {}
        async with server.connect("/view") as socket, asyncio.timeout(120):
            site, wanted = json.loads(await socket.recv()), None
            while wanted is None or shapes(blocks) != wanted:
                message = await socket.recv()
                if not isinstance(message, str):
                    block = Block(message, site["voxel_size_m"], site["origin"])
                    blocks[block.block] = block
                elif json.loads(message)["type"] == "whole":
                    assert (await loop.run_in_executor(None, undo, server, "digger", -1.0))[0] == 200
                    _, fresh = await loop.run_in_executor(None, lambda: asyncio.run(view(server, whole())))
                    wanted = shapes({block: b for (_, block), b in fresh.items()})
                    assert wanted and shapes(blocks) != wanted
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        take(server, [*deep, *flat])
        assert server.json("/height?x=2&y=0")["height_m"] < -0.3
        asyncio.run(work(server))
        height = server.json("/height?x=2&y=0")
        assert height["height_m"] == pytest.approx(height["before_m"], abs=1e-6)
        assert server.json("/volume?boundary=0,-1,4,-1,4,1,0,1")["cut_m3"] == pytest.approx(0, abs=1e-9)
        machines = {m["name"]: m for m in server.json("/machines")["machines"]}
        assert machines["digger"]["state"] is None and machines["plate"]["state"] is not None


def test_what_was_taken_back_may_be_sent_again_corrected_and_feeds_wait_meanwhile(tmp_path):
    path = scenario(tmp_path, SOIL + OUTPUT % "incremental: true")
    good = [{**state, "sequence": i} for i, state in enumerate(passes("digger", 0.0, 0.2, 80))]
    bad = [{**state, "position": [state["position"][0], 0.5, -0.6]} for state in good]
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        take(server, [*good[:40], *bad[40:]])

        async def work():
            loop = asyncio.get_running_loop()
            plates = list(passes("plate", 3.0, 0.2, 60))
            async with server.connect("/feed") as feed:
                undone = loop.run_in_executor(None, undo, server, "digger", good[39]["time"])
                for state in plates:
                    await feed.send(json.dumps(state))
                    assert "error" not in json.loads(await feed.recv())
                status, told = await undone
                assert status == 200 and told["states"] == 40
        asyncio.run(work())
        take(server, good[40:])
        dug = figures(server)
        server.kill()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert figures(server) == dug
    with Server(path, "--out", tmp_path / "never", cwd=tmp_path) as server:
        take(server, [*good[:40]])
        take(server, passes("plate", 3.0, 0.2, 60))
        take(server, good[40:])
        assert figures(server) == dug


def test_machines_that_came_and_clocks_that_were_set_stay(tmp_path):
    path, out = scenario(tmp_path, SOIL + OUTPUT % "incremental: true"), tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        take(server, passes("digger", 0.0, 0.2, 30))
        change(server, "/machines", {"add": THIRD})
        change(server, "/machines", {"rename": {"from": "plate", "to": "blade"}})
        take(server, passes("third", 0.5, 0.3, 30, begin=0.1))
        status, told = undo(server, "digger", 0.1)
        assert status == 200 and told["states"] == 19 and told["others"] == 30
        change(server, "/machines", {"retire": "digger"})
        assert undo(server, "third", 0.2)[1]["states"] > 0
        now = figures(server)
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert figures(server) == now and names(server) == ["blade", "third"]
        # A clock that was ahead and was set: its wrong times are not later than what follows.
        state = {"machine": "third", "rotation": [0, 0, 0, 1]}
        take(server, [{**state, "time": 900.0, "position": [4, 0.5, 0.5]}])
        assert server.get("/clock?machine=third", method="POST")[0] == 200
        take(server, [{**state, "time": t, "position": [4 + t / 100, 0.5, 0.5]} for t in (10.0, 11.0, 12.0)])
        assert undo(server, "third", 11.0, "GET")[1]["states"] == 1
        assert undo(server, "third", 5.0, "GET")[1]["states"] == 4
        assert undo(server, "third", 11.0)[1]["states"] == 1
        assert next(m for m in server.json("/machines")["machines"] if m["name"] == "third")["time_s"] == 11.0


def test_what_is_wrong_takes_nothing_back(tmp_path):
    (tmp_path / "looks").write_text("l00k")
    (tmp_path / "feeds").write_text("d1g")
    path = scenario(tmp_path, SOIL + OUTPUT % "keep: 2")
    with Server(path, "--token-file", "feeds", "--view-token-file", "looks", "--out", tmp_path / "out",
                cwd=tmp_path) as server:
        fed = {"Authorization": "Bearer d1g"}
        assert server.post("/feed", list(passes("digger", 0.0, 0.2, 10)), fed)[0] == 200
        journal = (tmp_path / "out/journal").read_bytes()
        for query, why in (("", "'machine' is missing"), ("?machine=digger", "'time' is missing"),
                           ("?machine=none&time=1", "there is no machine 'none'"),
                           ("?machine=digger&time=x", "'time' must be numbers"),
                           ("?machine=digger&time=1,2", "'time' must be one number"),
                           ("?machine=digger&time=1&more=2", "more")):
            for method in ("GET", "POST"):
                status, body = server.get("/undo" + query, fed, method)
                assert status == 400 and why in json.loads(body)["error"], (query, body)
        status, body = server.get("/undo?machine=digger&time=1", fed, "POST")
        assert status == 200 and json.loads(body)["states"] == 0
        look = {"Authorization": "Bearer l00k"}
        assert server.get("/undo?machine=digger&time=0", look, "POST")[0] == 403
        assert server.get("/undo?machine=digger&time=0", {}, "POST")[0] == 401
        assert (tmp_path / "out/journal").read_bytes() == journal
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        assert server.get("/undo?machine=digger&time=0", method="POST")[0] == 403
