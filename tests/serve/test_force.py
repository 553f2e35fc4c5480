# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of the soil on buckets, for viewers that ask for them."""
import asyncio
import json
import math
import subprocess

import numpy as np
import pytest
import soilvdb
from live import PROGRAM, Server, passes, scenario, view, whole

SOIL = "soil: {repose_angle: 0.6, swell: 0.2, density: 1800, cohesion: 3000}\n"
SYNCED = SOIL + "output: {journal: {sync: always}, snapshots: {every: 0.2}}\n"


def states():
    """Of both machines in turn. At its end the digger is lifted straight up, which cuts nothing."""
    for digger, plate in zip(passes("digger", 0.0, 0.25, 60), passes("plate", 4.0, 0.15, 60)):
        yield digger
        yield plate
    x, y, z = digger["position"]
    for i in range(1, 5):
        yield {**digger, "time": digger["time"] + 0.01 * i, "position": [x, y, z + 0.02 * i]}


def fed(path, until=math.inf):
    """A site of a scenario that was fed the states up to a time."""
    site = soilvdb.Site.open(path)
    for state in states():
        if state["time"] <= until:
            site.update(state["machine"], time=state["time"], position=state["position"],
                        rotation=state["rotation"])
    return site


def told_by(site, machines=("digger", "plate")):
    """What a message must have about a site."""
    told = []
    for name in machines:
        r = site.resistance(name)
        load = np.array(r.parts["load"].force)
        told.append((name, r.world.force, np.linalg.norm(load), r.limited))
    return told


def assert_told(message, site, machines=("digger", "plate")):
    assert [m["name"] for m in message["machines"]] == list(machines)
    for m, (name, force, load_n, limited) in zip(message["machines"], told_by(site, machines)):
        assert m["world_force_n"] == list(force), name
        assert np.linalg.norm(m["world_load_n"]) == pytest.approx(load_n, rel=1e-9)
        assert (m["limited"], m["why"]) == (limited, "")
    assert any(np.linalg.norm(m["world_force_n"]) > 1000 for m in message["machines"])


class Looking:
    """A viewer that reads texts until one that is looked for."""

    def __init__(self, socket):
        self.socket, self.seen = socket, []

    async def send(self, **request):
        await self.socket.send(json.dumps(request))

    async def until(self, wanted, seconds=60):
        async with asyncio.timeout(seconds):
            while True:
                message = await self.socket.recv()
                if not isinstance(message, str):
                    continue
                self.seen.append(json.loads(message))
                if wanted(self.seen[-1]):
                    return self.seen[-1]

    async def until_type(self, kind):
        return await self.until(lambda m: m["type"] == kind)

    def forces(self):
        return [m for m in self.seen if m["type"] == "force"]


def looking(server, work):
    """Runs `work` with a viewer."""
    async def run():
        async with server.connect("/view") as socket:
            return await work(Looking(socket))
    return asyncio.run(run())


async def feed(server, states):
    async with server.connect("/feed") as socket:
        for state in states:
            await socket.send(json.dumps(state))
            assert "error" not in json.loads(await socket.recv())


def test_forces_are_those_of_a_site_of_the_same_now_and_at_other_times(tmp_path):
    path = scenario(tmp_path, SYNCED)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(states())
        last_s = list(states())[-1]["time"]

        async def work(viewer):
            await viewer.send(force=True)
            now = await viewer.until_type("force")
            assert now["id"] == 0
            assert_told(now, fed(path))
            for time_s in (0.3, 0.45, last_s):
                await viewer.send(time=time_s)
                shown = await viewer.until_type("view")
                past = await viewer.until_type("force")
                assert past["id"] == shown["id"] > 0
                assert_told(past, fed(path, time_s))
            # Another time is asked for once; live forces go on when it is live again.
            count = len(viewer.forces())
            await viewer.until_type("state")
            await viewer.until_type("state")
            assert len(viewer.forces()) == count
            await viewer.send(time=None, against=0.3)   # live machines, on ground that is compared
            await viewer.until_type("view")
            assert (await viewer.until_type("force"))["machines"] == now["machines"]
            await viewer.send(time=0.3)
            await viewer.until_type("view")
            await viewer.until_type("force")
            await viewer.send(force=False)
            await viewer.send(force=True)
            assert_told(await viewer.until_type("force"), fed(path, 0.3))
        looking(server, work)
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        async def work_on_folder(viewer):
            await viewer.send(force=True)
            assert_told(await viewer.until_type("force"), fed(path))
        looking(server, work_on_folder)


def test_forces_follow_machines_that_dig_after_each_message(tmp_path):
    path = scenario(tmp_path, SOIL)
    site, all_states = soilvdb.Site.open(path), list(states())
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        async def work(viewer):
            await viewer.send(force=True)
            assert (await viewer.until_type("force"))["machines"] == []   # none was seen yet
            for k in range(0, len(all_states), 24):
                part = all_states[k:k + 24]
                await feed(server, part)
                for state in part:
                    site.update(state["machine"], time=state["time"], position=state["position"],
                                rotation=state["rotation"])
                wanted = [list(force) for _, force, *_ in told_by(site)]
                message = await viewer.until(
                    lambda m: m["type"] == "force" and
                    [one["world_force_n"] for one in m["machines"]] == wanted)
                assert_told(message, site)
        looking(server, work)


def test_nothing_is_computed_for_viewers_that_did_not_ask(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        every = list(states())

        async def work():
            async with (server.connect("/view", close_timeout=1) as one,
                        server.connect("/view", close_timeout=1) as other):
                silent, asks = Looking(one), Looking(other)
                await feed(server, every[:60])
                last_s = every[59]["time"]
                await silent.until(lambda m: m["type"] == "state" and m["time_s"] == last_s)
                assert silent.forces() == []
                await asks.send(force=True)
                first = await asks.until_type("force")
                assert first["number"] == 1, "none was computed before"
                last_s = every[-1]["time"]
                await asyncio.gather(
                    feed(server, every[60:]),
                    asks.until(lambda m: m["type"] == "state" and m["time_s"] == last_s))
                await asks.until_type("force")
                await asks.send(force=False)
                await asks.send(force="yes")   # the answer to which comes after that to the former
                await asks.until_type("error")
                count = asks.forces()[-1]["number"]
                # With states, of which a slow reader misses some; not with updates.
                assert count <= 2 * sum(m["type"] == "state" for m in asks.seen) + 2
                for _ in range(3):
                    await asks.until_type("state")
                assert asks.forces()[-1]["number"] == count
                await asks.send(force=True)
                assert (await asks.until_type("force"))["number"] <= count + 2
                for _ in range(2):
                    await silent.until_type("state")
                assert silent.forces() == []
        asyncio.run(work())


def test_who_cannot_have_a_force_is_told_why(tmp_path):
    refusals = [({"force": 1}, "'force' must be true or false"),
                ({"force": True, "time": 1}, "or 'force' only"), ({"forces": True}, "or 'force' only")]
    (tmp_path / "auger.stl").write_text("solid a\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
        + "endloop\nendfacet\n" for corners in [
            [(0, 0, 0), (0, 1, 0), (1, 0, 0)], [(0, 0, 0), (1, 0, 0), (0, 0, 1)],
            [(0, 0, 0), (0, 0, 1), (0, 1, 0)], [(1, 0, 0), (0, 1, 0), (0, 0, 1)]]) + "endsolid a\n")
    path = scenario(tmp_path, "  - {name: auger, tool: {mesh: auger.stl}}\n" + SOIL)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        above = {"position": [0, 9, 3], "rotation": [0, 0, 0, 1]}
        server.feed([{"machine": "auger", **above}, {"machine": "plate", **above}])

        async def work(viewer):
            for request, why in refusals:
                await viewer.send(**request)
                assert why in (await viewer.until_type("error"))["error"]
            await viewer.send(force=True)
            plate, auger = (await viewer.until_type("force"))["machines"]
            assert (plate["name"], plate["world_force_n"], plate["why"]) == ("plate", [0, 0, 0], "")
            assert (auger["name"], auger["world_force_n"]) == ("auger", None)
            assert "closed tool" in auger["why"]
        looking(server, work)
    (tmp_path / "rigid").mkdir()
    with Server(scenario(tmp_path / "rigid"), cwd=tmp_path) as server:
        async def work_on_rigid(viewer):
            await viewer.send(force=True)
            assert "needs the scenario's 'soil'" in (await viewer.until_type("error"))["error"]
        looking(server, work_on_rigid)


def test_a_scenario_that_is_played_and_its_run_have_forces(tmp_path):
    rows = "".join(f"{i / 10},{i / 20},0,-0.2,0,0,0,1\n" for i in range(41))
    (tmp_path / "m.csv").write_text("time,x,y,z,qx,qy,qz,qw\n" + rows)
    path = tmp_path / "played.yaml"
    path.write_text("soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0.0}}\n" + SOIL +
                    "machines:\n  - {name: m, bucket: {width: 1.0, height: 0.8}, motion: m.csv}\n")
    with Server(path, "--speed", "20", cwd=tmp_path) as server:
        async def work(viewer):
            await viewer.send(force=True)
            await viewer.until(lambda m: m["type"] == "state" and m["time_s"] == 4.0)
            return (await viewer.until_type("force"))["machines"]
        played, = looking(server, work)
    assert played["world_force_n"][0] < -500 and played["limited"] == "steep blade"
    subprocess.run([PROGRAM, "run", path, "--out", tmp_path / "out"], check=True, capture_output=True)
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        ended, = looking(server, work)   # its soil has come to rest
        assert ended["world_force_n"][0] == pytest.approx(played["world_force_n"][0], rel=0.2)


def test_a_viewer_that_asks_sees_the_same_ground(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(states())
        _, plain = asyncio.run(view(server, whole()))
        _, asked = asyncio.run(view(server, whole(), [{"force": True}]))
    assert plain.keys() == asked.keys()
    for key, block in plain.items():
        assert np.array_equal(block.lattice, asked[key].lattice)
