# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What whoever watches a site is told at once."""
import asyncio
import itertools
import json
import re
import subprocess
import time
from random import Random

from live import PROGRAM, Server, scenario
from test_disk import fill, small_disk
from test_links import BareFeed
from test_serve import write_flat


def at(x, y, z, time_s=None, machine="digger", **more):
    state = {"machine": machine, "position": [x, y, z], "rotation": [0, 0, 0, 1], **more}
    return state if time_s is None else {**state, "time": time_s}


def kinds(server):
    return {(alarm["kind"], alarm["machine"]): alarm["text"] for alarm in server.json("/alarms")
            if alarm["kind"] != "disk"}


async def feed(socket, *states):
    for state in states:
        await socket.send(json.dumps(state))
        answer = json.loads(await socket.recv())
        assert "error" not in answer, answer


def test_a_bucket_below_the_design_or_outside_the_boundary_alarms(tmp_path):
    write_flat(tmp_path / "plan.asc", -10)
    (tmp_path / "edge.csv").write_text("-5,-5\n5,-5\n5,5\n-5,5\n-5,-5\n")
    with Server(scenario(tmp_path), "--design", "plan.asc", "--boundary", "edge.csv", "--out",
                tmp_path / "out", cwd=tmp_path) as server:
        async def work():
            async with server.connect("/feed") as socket:
                await feed(socket, at(0, 0, 1), at(0, 0, 0.5, machine="plate"))
                assert kinds(server) == {}
                await feed(socket, at(0, 0, -0.04))
                assert kinds(server) == {}, "finest work"
                await feed(socket, at(0, 0, -0.2))
                assert kinds(server) == {("below_design", "digger"): "its lip is 0.20 m below the design"}
                by_m = {alarm["kind"]: alarm.get("by_m") for alarm in server.json("/alarms")}
                assert abs(by_m["below_design"] - 0.2) < 1e-9 and by_m.get("disk") is None
                # Tilted by 0.3 rad, an end of the lip is 0.18 m lower than its middle.
                await feed(socket, at(0, 0, 0.1, rotation=[0.14943813, 0, 0, 0.98877108]))
                assert kinds(server) == {("below_design", "digger"): "its lip is 0.08 m below the design"}
                await feed(socket, at(8, 9, 1), at(0, 4.9, 1, machine="plate"))
                assert kinds(server) == {("outside", "digger"): "it is 5.0 m outside the boundary"}
                await feed(socket, at(0, 0, 1))
                assert kinds(server) == {}
        asyncio.run(work())
    for name, text, why in (("none.csv", None, "none.csv"), ("two.csv", "0,0\n1,1\n", "3 corners or more"),
                            ("bad.csv", "0,0\n1;1\n2,2\n", "bad.csv:2: '1;1' is no corner x,y")):
        if text is not None:
            (tmp_path / name).write_text(text)
        refused = subprocess.run([PROGRAM, "serve", tmp_path / "site.yaml", "--boundary", name, "--port", "0"],
                                 cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert refused.returncode == 2 and why in refused.stderr, refused


def test_lost_feeds_wrong_clocks_and_bad_positions_alarm(tmp_path):
    async def work(server):
        async with server.connect("/view") as viewer, server.connect("/feed") as socket:
            now = time.time()
            await feed(socket, at(0, 0, 1, now - 300, fix="rtk_fixed"))
            assert kinds(server) == {("clock", "digger"): "its times are 5 min behind this computer's clock"}
            await feed(socket, at(0, 0, 1, now - 1))
            assert kinds(server) == {}
            await feed(socket, at(0, 0, 1, now + 60, "plate", fix="rtk_float"))
            told = kinds(server)
            assert told.pop(("fix", "plate")) == "its position is rtk_float, so it digs nothing"
            assert told == {("clock", "plate"): "its times are 60 s ahead of this computer's clock"}
            bare = BareFeed(server)
            await socket.close()
            assert kinds(server) == {}, "whoever says goodbye is not missed"
            assert "error" not in bare.feed(at(0, 0, 1, time.time()))
            begin = time.monotonic()

            async def lost(is_lost=True):
                """The alarm's text, once there is one, or none."""
                while True:
                    message = await asyncio.wait_for(viewer.recv(), 5)
                    if isinstance(message, str) and (state := json.loads(message))["type"] == "state":
                        texts = [a["text"] for a in state["alarms"] if a["kind"] == "feed_lost"]
                        assert [a["machine"] for a in state["alarms"] if a["text"] in texts] == ["digger"] * len(texts)
                        if bool(texts) == is_lost:
                            return texts

            def seconds(told, text):
                return map(int, re.fullmatch(told + " ([0-9]+) s[a-z ]*; its last state came ([0-9]+) s ago", *text).groups())

            silent_s, state_s = seconds("nothing is heard of it for", await lost())
            assert silent_s >= 4 and abs(state_s - silent_s) <= 1 and 2 < time.monotonic() - begin < 5
            bare.send(b"", opcode=10)  # an answer to a ping is heard, and is no state
            await lost(False)
            silent_s, state_s = seconds("nothing is heard of it for", await lost())
            assert silent_s >= 4 and state_s >= silent_s + 2
            bare.send(b"", opcode=10)
            await lost(False)
            bare.break_off()
            broke_s, state_s = seconds("its connection broke off", await lost())
            assert broke_s <= 1 and state_s >= 6
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        assert server.get("/alarms")[0] == 400


def test_a_disk_that_fills_alarms_before_and_after_it_is_full(tmp_path):
    with small_disk(tmp_path / "disk", 2000) as disk:
        with Server(scenario(tmp_path), "--out", disk / "out", cwd=tmp_path) as server:
            alarm, = server.json("/alarms")
            assert alarm["kind"] == "disk" and "has only 2 MB left" in alarm["text"]
            fill(disk)
            until, random = time.monotonic() + 60, Random(1)
            for i in itertools.count():
                # What compresses badly, so that the journal soon needs a block that isn't there.
                server.feed([at(random.uniform(0, 0.05), random.uniform(0, 0.05), 1, 0.01 * i)])
                alarm, = server.json("/alarms")
                if alarm["kind"] == "recording":
                    break
                assert time.monotonic() < until, f"{i} states were recorded on a full disk: {alarm}"
            assert "No space left on device" in alarm["text"] and alarm["machine"] is None
