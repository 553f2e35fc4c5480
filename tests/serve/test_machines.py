# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""How machines are fed: by one feed each, numbered, and with a position that is good enough."""
import asyncio
import json
import time

import pytest
from live import Server, passes, scenario, view, whole
from test_feeds import START, excavator
from test_links import BareFeed

SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\n"
STATES = list(passes("digger", 0.0, 0.3, 60))


def machines(server):
    return {machine["name"]: machine for machine in server.json("/machines")["machines"]}


def digest(server):
    return server.json("/summary.json")["state_hash"]


async def answer(feed, state):
    await feed.send(json.dumps(state))
    return json.loads(await feed.recv())


def test_machines_say_where_their_feed_goes_on(tmp_path):
    path = excavator(tmp_path)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        before = machines(server)["excavator"]
        assert [before[key] for key in ("link", "owner", "heard_s_ago", "sequence", "time_s", "state")] == [
            "none", None, None, None, None, None]
        sent = {"machine": "excavator", "time": 1.5, "joints": START, "sequence": 7, "fix": "rtk_fixed"}

        async def work():
            async with server.connect("/feed") as feed:
                assert "error" not in await answer(feed, sent)
                await asyncio.sleep(0.3)
                there = machines(server)["excavator"]
                assert there["link"] == "live" and there["owner"].startswith("127.0.0.1:")
                assert there["sequence"] == 7 and there["fix"] == "rtk_fixed"
                assert 0.3 <= there["heard_s_ago"] < 3 and there["time_s"] == 1.5
        asyncio.run(work())
        after = machines(server)["excavator"]
        assert after["link"] == "none" and after["owner"] is None
        state = after["state"]
        server.stop()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        again = machines(server)["excavator"]
        assert again["state"] == state == {key: sent[key] for key in ("machine", "time", "joints")}
        assert server.json("/machines")["acknowledged_s"] == 1.5
        onward, = server.feed([state])
        assert onward["cut_m3"] == 0, "what it says can be fed"


def test_a_state_that_is_sent_again_is_answered_and_not_dug_again(tmp_path):
    """A machine that goes back would dig again: its states have no times."""
    def numbered(i, n):
        state = {key: value for key, value in STATES[i].items() if key != "time"}
        return {**state, "sequence": n}
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "once", cwd=tmp_path) as server:
        server.feed(numbered(i, i) for i in range(60))
        wanted = digest(server)
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        first = server.feed(numbered(i, i) for i in range(40))
        assert [answer["sequence"] for answer in first] == list(range(40))
        again = server.feed(numbered(i, i) for i in range(20, 60))  # the link broke off meanwhile
        assert again[:20] == [{**answer, "repeated": True} for answer in first[20:]]
        assert not any("repeated" in answer or "error" in answer for answer in again[20:])
        assert digest(server) == wanted and server.json("/summary.json")["updates"] == 60
        # Other states under known numbers are refused.
        other, old = server.feed([numbered(30, 59), numbered(31, 50)])
        assert "'sequence' is 59, which another state had; the next is 60" in other["error"]
        assert "'sequence' is 50" in old["error"] and digest(server) == wanted
        # A gap is told; so is one before a state that is refused, which may be sent again.
        gap, bad, *good = server.feed([numbered(59, 63), {**numbered(59, 70), "fix": "good"},
                                       {**numbered(59, 70), "fix": "rtk_fixed"}, numbered(59, 71)])
        assert gap["missed"] == 3 and "error" not in gap
        assert bad["missed"] == 6 and "there are 'rtk_fixed'" in bad["error"]
        assert not any("missed" in answer or "error" in answer for answer in good), good
        # A program that begins again counts from 0.
        begun = server.feed([numbered(58, 0), numbered(57, 1), numbered(58, 0)])
        assert not any("error" in answer or "missed" in answer for answer in begun)
        assert begun[2] == {**begun[0], "repeated": True}
        assert machines(server)["digger"]["sequence"] == 1
        for bad in (-1, 1.5, "1", 2**60):
            refused, = server.feed([numbered(58, bad)])
            assert "'sequence' must be a whole number" in refused["error"]


def test_a_second_feed_of_a_machine_is_refused_while_the_first_lives(tmp_path):
    async def work(server):
        async with server.connect("/feed") as first, server.connect("/feed") as second:
            assert "error" not in await answer(first, STATES[0])
            before = digest(server)
            refused = await answer(second, {**STATES[1], "position": [1, 5, -0.3]})
            assert "machine 'digger' is fed by 127.0.0.1:" in refused["error"]
            assert digest(server) == before
            assert "error" not in await answer(second, {**STATES[1], "machine": "plate"}), "it may feed others"
            assert "error" not in await answer(first, STATES[1])
            await first.close()
            assert "error" not in await answer(second, STATES[2]), "it takes over"
            silent = BareFeed(server)
            assert "'digger' is fed by" in silent.feed(STATES[3])["error"]
            await second.close()
            assert "error" not in silent.feed(STATES[3])
            async with server.connect("/feed") as third:
                begin = time.monotonic()
                while "error" in await answer(third, {**STATES[4], "time": 10.0}):
                    assert time.monotonic() - begin < 5
                    await asyncio.sleep(0.1)
                assert time.monotonic() - begin > 2
                assert "is fed by" in silent.feed({**STATES[5], "time": 11.0})["error"]
            silent.close()
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


@pytest.mark.parametrize("fix", ["rtk_float", "single"])
def test_a_position_that_is_not_fixed_digs_nothing(tmp_path, fix):
    def at(time_s, x, z, **more):
        return {"machine": "digger", "time": time_s, "position": [x, 0.0, z], "rotation": [0, 0, 0, 1], **more}
    path = scenario(tmp_path, "output: {journal: {sync: always}}\n")
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed([at(0, 0, 1), at(1, 0.0, -0.2), at(2, 1.0, -0.2)])
        dug, load = digest(server), machines(server)["digger"]["bucket_m3"]
        assert load > 0.1
        # In the ground nothing is known of its way; above it, it is placed.
        below, above, away = server.feed([at(3, 2.0, -0.8, fix=fix), at(4, 2.0, 1.5, fix=fix),
                                          at(5, 12.0, 1.5, fix=fix)])
        assert below["placed"] is False and above["placed"] is True and away["placed"] is True
        for told in (below, above, away):
            assert told["cut_m3"] == 0 and told["bucket_m3"] == pytest.approx(load)
        assert digest(server) == dug
        there = machines(server)["digger"]
        assert there["fix"] == fix and there["state"]["position"] == [12.0, 0.0, 1.5]
        texts, _ = asyncio.run(view(server, whole()))
        assert {text["machines"][0]["fix"] for text in texts if text["type"] == "state"} == {fix}
        server.kill()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        # The first that is fixed again does not dig its way from a place that was wrong.
        fixed, down, along = server.feed([at(6, 12.0, 0.5, fix="rtk_fixed"), at(7, 12.0, 0.1, fix="rtk_fixed"),
                                          at(8, 13.0, 0.1)])
        assert fixed["placed"] is True and "placed" not in down
        assert along["cut_m3"] > 0.1
        assert server.json("/height?x=6&y=0")["height_m"] == pytest.approx(0.12, abs=0.02), "on its way"
        assert server.json("/summary.json")["volume_m3"]["residual"] == pytest.approx(0, abs=1e-9)
        refused, = server.feed([at(9, 13.0, 0.1, fix="none")])
        assert "'fix' is 'none'; there are 'rtk_fixed', 'rtk_float' and 'single'" in refused["error"]
