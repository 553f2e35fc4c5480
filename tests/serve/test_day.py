# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A day of five machines, and the report at its end, which is that of the answers that they got."""
import asyncio
import collections
import csv
import json
import math
import os
import random
import shlex
import subprocess
import time

import numpy as np
import pytest
from live import Server
from osgeo import gdal
from test_alarms import kinds
from test_disk import fill, small_disk
from test_links import BareFeed
from test_report import (BANK_UNITS, DENSITY, SAMPLE_M3, SWELL, UNITS_PER_SAMPLE, VOXEL_M, cycle, require_sums,
                         turned)

gdal.UseExceptions()
HOUR_S, STEP_S, DESIGN_M = 3600, 8.0, -0.4
PROFILE = [[0, 0], [-0.5, 0.1], [-0.6, 0.6], [0, 0.9]]
BUCKETS = {"digger": {"width": 1.2, "height": 0.9, "profile": PROFILE},
           "backhoe": {"width": 0.8, "height": 0.9, "profile": PROFILE},
           "dozer": {"width": 1.0, "height": 0.6},   # a blade, which never counts a cycle
           "loader": {"width": 1.4, "height": 0.9, "profile": PROFILE},
           "newcomer": {"width": 1.0, "height": 0.9, "profile": PROFILE}}
TRUCK = {"name": "truck", "box": [4.5, -3, 8, 9], "top": 0.5}
LANES_M = {name: 6.0 * i for i, name in enumerate(BUCKETS)}
SITE = f"""\
soilvdb: 1
voxel_size: {VOXEL_M}
terrain: {{plane: {{z: 0.0}}}}
machines: {json.dumps([{"name": name, "bucket": bucket} for name, bucket in list(BUCKETS.items())[:4]])}
soil: {{repose_angle: 0.6, swell: {SWELL}, density: {DENSITY}}}
hoppers: [{json.dumps(TRUCK)}]
output: {{journal: {{sync: always}}, snapshots: {{every: {2 * HOUR_S}}}}}
"""
SECONDS = 60   # that anything may take


async def until(found, why):
    """Asks until there is an answer."""
    end = time.monotonic() + SECONDS
    while not (answer := await asyncio.to_thread(found)):
        assert time.monotonic() < end, why
        await asyncio.sleep(0.02)
    return answer


class Machine:
    """Sends numbered states and keeps what was answered, by true times."""

    def __init__(self, server, name):
        self.server, self.name, self.number, self.ahead_s = server, name, 0, 0.0
        self.taken, self.refused, self.begun, self.cycles, self.link = [], collections.Counter(), 0, 0, None

    async def connect(self):
        self.link = await self.server.connect("/feed").__aenter__()

    async def try_(self, state):
        await self.link.send(json.dumps({**state, "time": state["time"] + self.ahead_s, "sequence": self.number}))
        return json.loads(await self.link.recv())

    def take(self, state, answer):
        assert answer["sequence"] == self.number and "missed" not in answer, answer
        self.taken.append((state, answer))
        self.number += 1

    async def send(self, state):
        """Again and again until it is taken, as a machine that knows no better does."""
        end = time.monotonic() + SECONDS
        while "error" in (answer := await self.try_(state)):
            why = [words for words in ("No space left on device; states are refused until there is room",
                                       "more than an hour ahead of the site's latest", "is fed by")
                   if words in answer["error"]]
            assert why and time.monotonic() < end, answer
            self.refused[why[0]] += 1
            await asyncio.sleep(0.02)
        self.take(state, answer)
        return answer

    def cycle(self, begin_s, tips=True):
        """Digs where soil is left, and tips: over the truck, or on a heap."""
        layer, row = divmod(self.begun, 3)
        self.begun += 1
        self.cycles += tips and self.name != "dozer"
        states = list(cycle(self.name, LANES_M[self.name] + 1.5 * (row - 1), begin_s, STEP_S, tips,
                            5.5 if self.name in ("digger", "backhoe") else 4.0))
        for state in states:
            state["position"][2] -= 0.15 * layer
        return states

    async def work(self, begin_s, tips=True):
        for state in self.cycle(begin_s, tips):
            await self.send(state)


def begin_of(machine, hour_s):
    """Machines begin one after another."""
    return hour_s + 60 + 240 * list(LANES_M).index(machine.name)


async def cut_link(machine, viewer, begin_s):
    """Its cable is cut while it waits for an answer; it comes back on another, and others work meanwhile."""
    states, server = machine.cycle(begin_s), machine.server
    for state in states[:12]:
        await machine.send(state)
    await machine.link.close()
    bare = BareFeed(server)   # which answers no ping
    await until(lambda: server.json("/machines")["machines"][1]["link"] == "none", "it said goodbye")
    machine.take(states[12], await asyncio.to_thread(bare.feed, {**states[12], "sequence": machine.number}))
    bare.send(json.dumps({**states[13], "sequence": machine.number}).encode())
    await until(lambda: server.json("/machines")["machines"][1]["sequence"] == machine.number, "it is taken")
    assert server.json("/machines")["machines"][1]["link"] == "live"
    await machine.connect()
    repeated = await machine.send(states[13])   # refused until the site has lost the old link
    assert repeated["repeated"] and machine.refused["is fed by"] > 0, "dug once"
    async with asyncio.timeout(SECONDS):
        while viewer["links"][machine.name][-2:] != ["lost", "live"]:
            await viewer["told"].wait()
    for state in states[14:]:
        await machine.send(state)
    bare.close()


async def wrong_clock(machine, hour_s):
    """Its clock is a year ahead, then 50 minutes into the next hour, and then set right."""
    server, first, second = machine.server, machine.cycle(hour_s + 1200), machine.cycle(hour_s + 1800)
    machine.ahead_s = 366 * 86400
    answer = await machine.try_(first[0])
    assert "ahead of this computer's clock; set the clock that is wrong" in answer["error"]
    ahead_min = round((first[0]["time"] + machine.ahead_s - time.time()) / 60)
    assert kinds(server)["clock", machine.name] in [
        f"its times are {minutes} min ahead of this computer's clock" for minutes in (ahead_min, ahead_min + 1)]
    machine.ahead_s = 3000
    for state in first:
        await machine.send(state)
    machine.ahead_s = 0.0
    answer = await machine.try_(second[0])
    assert "if its clock was ahead and is right now, confirm it: curl" in answer["error"], answer
    command = answer["error"].split("confirm it: ")[1]
    done = await asyncio.to_thread(subprocess.run, shlex.split(command), capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and "error" not in done.stdout, done
    for state in first:
        state["counts_s"] = second[0]["time"]   # when it is known that their times are wrong
    for state in second:
        await machine.send(state)


async def full_disk(machines, disk, hour_s):
    """One stands and trembles until the disk is full; then all begin, and wait until there is room."""
    server, rng = machines[0].server, random.Random(1)
    no_room = "No space left on device; states are refused until there is room"
    stands = machines[3]
    fill(disk)
    for i in range(1500):
        state = {"machine": stands.name, "time": hour_s + i, "rotation": turned(0),
                 "position": [rng.uniform(0, 0.003), LANES_M[stands.name] + rng.uniform(0, 0.003), 1.5]}
        answer = await stands.try_(state)
        if "error" not in answer:
            stands.take(state, answer)
        elif no_room in answer["error"]:
            break
        else:
            assert i == 0 and "more than an hour ahead of the site's latest" in answer["error"], answer
    assert no_room in answer["error"], "it never filled"
    before = server.json("/summary.json"), server.get("/report.csv")

    async def go_on(machine):
        if machine is stands:
            await machine.send(state)   # which was taken, but not on disk
        await machine.work(begin_of(machine, hour_s) + 1800)
    tasks = [asyncio.create_task(go_on(machine)) for machine in machines]
    await until(lambda: all(machine.refused[no_room] > 0 for machine in machines), "all are refused")
    assert "No space left" in kinds(server)["recording", None]
    assert server.json("/summary.json")["state_hash"] == before[0]["state_hash"]
    assert server.get("/report.csv") == before[1], "what is refused is no work"
    os.remove(disk / "other")
    await asyncio.gather(*tasks)
    assert ("recording", None) not in kinds(server)


async def watch(server, seen):
    """The links of machines as whoever looks sees them, each once."""
    async with server.connect("/view") as viewer:
        async for message in viewer:
            if isinstance(message, str) and (now := json.loads(message))["type"] == "state":
                for machine in now["machines"]:
                    links = seen["links"].setdefault(machine["name"], [])
                    if links[-1:] != [machine["link"]]:
                        links.append(machine["link"])
                seen["last"] = now
                seen["told"].set()
                seen["told"].clear()


async def join(machines, hour_s):
    """Another machine comes while the others work."""
    server = machines[0].server
    add = {"name": "newcomer", "bucket": BUCKETS["newcomer"]}
    status, answer = await asyncio.to_thread(server.post, "/machines", [{"add": add}])
    assert status == 200, answer
    machines.append(Machine(server, "newcomer"))
    await machines[-1].connect()
    await machines[-1].work(begin_of(machines[-1], hour_s))


async def play(server, disk, hours_s):
    machines = digger, backhoe, dozer, loader = [Machine(server, name) for name in list(BUCKETS)[:4]]
    viewer = {"links": {}, "told": asyncio.Event()}
    watching = asyncio.create_task(watch(server, viewer))
    for machine in machines:
        await machine.connect()

    def work(hour, *of, tips=True):
        return [machine.work(begin_of(machine, hours_s[hour]), tips) for machine in of]
    await asyncio.gather(*work(0, *machines))
    await asyncio.gather(*work(1, digger, dozer, loader), cut_link(backhoe, viewer, begin_of(backhoe, hours_s[1])))
    await asyncio.gather(*work(2, digger, backhoe, loader), wrong_clock(dozer, hours_s[2]))
    await asyncio.gather(*work(3, *machines), join(machines, hours_s[3]))
    await full_disk(machines, disk, hours_s[5])   # after a break of an hour
    await asyncio.gather(*work(6, *machines[1:]), *work(6, digger, tips=False))
    for machine in machines:
        await machine.link.close()
    await until(lambda: all(machine["link"] == "none" for machine in server.json("/machines")["machines"]), "goodbye")
    watching.cancel()
    return machines


def durations(states):
    """By hour, how long a machine works and stands, by the states that it sent."""
    working, idle = collections.Counter(), collections.Counter()
    stood, moved_s, before_s = None, None, -math.inf

    def spread(to, begin_s, end_s):
        while begin_s < end_s:
            next_s = min(end_s, (begin_s // HOUR_S + 1) * HOUR_S)
            to[begin_s // HOUR_S * HOUR_S] += next_s - begin_s
            begin_s = next_s
    for state in states:
        now_s, place = state["time"], np.array([*state["position"], *state["rotation"]])
        moved = stood is None or (np.linalg.norm((place - stood)[:3]) > 0.03
                                  or 2 * math.acos(min(1, abs(place[3:] @ stood[3:]))) > 0.03)
        if moved:
            stood, moved_s = place, now_s
        if now_s - before_s <= 60:
            stops_s = max(before_s, min(now_s, moved_s + 10))
            spread(working, before_s, stops_s)
            spread(idle, stops_s, now_s)
        before_s = now_s
    return working, idle


class Sums:
    """What a machine was answered in an hour, in whole samples and units of mass."""

    def __init__(self):
        self.cut = self.put_down = self.over_truck = self.on_its_edge = self.cycles = 0
        self.kg, self.times, self.loads_m3 = 0.0, [], []


def sums_of(machine):
    hours, before_kg, peak_m3, was_over = collections.defaultdict(Sums), 0.0, 0.0, False
    x0, y0, x1, y1 = TRUCK["box"]
    for state, answer in machine.taken:
        of = hours[state["time"] // HOUR_S * HOUR_S]
        of.times.append(state.get("counts_s", state["time"]))
        of.cut += round(answer["cut_m3"] / SAMPLE_M3)
        spilled = round(answer["spilled_m3"] / SAMPLE_M3 * UNITS_PER_SAMPLE)
        of.put_down += spilled
        is_over = x0 < state["position"][0] < x1 and y0 < state["position"][1] < y1
        of.over_truck += spilled * (is_over and was_over)
        of.on_its_edge += spilled * (is_over != was_over)
        was_over = is_over
        of.kg += answer["bucket_kg"] - before_kg + spilled / BANK_UNITS * SAMPLE_M3 * DENSITY
        before_kg, peak_m3 = answer["bucket_kg"], max(peak_m3, answer["bucket_m3"])
        if answer["bucket_m3"] < 0.1 * peak_m3:   # a load is over, which a person would see
            of.cycles += 1
            of.loads_m3.append(peak_m3)
            peak_m3 = 0.0
    return hours


def rows_of(server, path):
    status, body = server.get(path)
    assert status == 200, body
    return list(csv.DictReader(body.decode().splitlines()))


def table(server, path):
    return {(row["machine"], row["span"], row["from_s"]): row for row in rows_of(server, path)}


def changes(server, folder):
    """Of the ground, by the raster that others read: x and y of columns, changes, area of a column."""
    (folder / "surface.tif").write_bytes(server.get("/surface.tif")[1])
    data = gdal.Open(str(folder / "surface.tif"))
    x0, dx, _, y0, _, dy = data.GetGeoTransform()
    bands = {data.GetRasterBand(i).GetDescription(): data.GetRasterBand(i).ReadAsArray() for i in (1, 2)}
    rows, columns = bands["change"].shape
    return (x0 + dx * (np.arange(columns) + 0.5)[None, :], y0 + dy * (np.arange(rows) + 0.5)[:, None],
            bands["change"].astype(float), abs(dx * dy))


def require_report(server, machines, begin_s):
    """The report has the sums of the answers, by machine and hour."""
    rows = table(server, "/report.csv?every=3600")
    hours_s = sorted({row["from_s"] for row in rows.values() if row["span"] == "period"}, key=float)
    assert [float(hour) for hour in hours_s] == [begin_s + HOUR_S * i for i in range(7)]
    for machine in machines:
        sums = sums_of(machine)
        works_s, stands_s = durations([state for state, _ in machine.taken])
        for hour in hours_s:
            row, of = rows[machine.name, "period", hour], sums[float(hour)]
            where = machine.name, hour, row
            assert float(row["cut_m3_bank"]) == of.cut * SAMPLE_M3, where
            loose = {name: round(float(row[f"{name}_m3_loose"]) / SAMPLE_M3 * UNITS_PER_SAMPLE)
                     for name in ("put_down", "hauled")}
            assert loose["put_down"] == of.put_down, where
            assert of.over_truck <= loose["hauled"] <= of.over_truck + of.on_its_edge, where
            assert float(row["load_t"]) * 1000 == pytest.approx(of.kg, rel=1e-9, abs=1e-9), where
            assert int(row["cycles"]) == of.cycles, where
            assert float(row["working_s"]) == pytest.approx(works_s[float(hour)], abs=1e-3), where
            assert float(row["idle_s"]) == pytest.approx(stands_s[float(hour)], abs=1e-3), where
            assert row["first_state_s"] == "" if not of.times else float(row["first_state_s"]) == min(of.times), where
            assert row["last_state_s"] == "" if not of.times else float(row["last_state_s"]) == max(of.times), where
        assert sum(of.cycles for of in sums.values()) == machine.cycles, "as it tipped"
        hauls = machine.name in ("digger", "backhoe")
        told = [sum(getattr(of, name) for of in sums.values()) for name in ("over_truck", "on_its_edge")]
        assert told[0] > 100 * told[1] if hauls else told == [0, 0], "the truck tells much"
    # A shift from the third hour on, cut off there.
    shift = table(server, f"/report.csv?from={begin_s + 2 * HOUR_S}&every=86400")
    for machine in machines:
        cut = sum(of.cut for hour, of in sums_of(machine).items() if hour >= begin_s + 2 * HOUR_S)
        assert float(shift[machine.name, "total", f"{begin_s + 2 * HOUR_S:.0f}"]["cut_m3_bank"]) == cut * SAMPLE_M3


def require_ground(server, machines, folder, pit, area):
    """The ground and the loads are what the ledger says, and the area is as far from its design."""
    x, y, change, cell_m2 = changes(server, folder)
    summary = server.json("/summary.json")
    balance = summary["mass_kg"]
    assert summary["volume_m3"]["residual"] == balance["residual"] == 0
    assert change.sum() * cell_m2 == pytest.approx(summary["volume_m3"]["ground_change"], abs=1e-4)
    assert summary["volume_m3"]["cut"] == sum(of.cut for m in machines for of in sums_of(m).values()) * SAMPLE_M3
    loads = {row["machine"]: row for row in rows_of(server, "/machines.csv")}
    for machine in machines:
        last = machine.taken[-1][1]
        assert float(loads[machine.name]["bucket_m3"]) == last["bucket_m3"]
        assert float(loads[machine.name]["bucket_kg"]) == last["bucket_kg"]
        of_cycles = [load for of in sums_of(machine).values() for load in of.loads_m3]
        assert loads[machine.name]["last_load_m3"] == (str(of_cycles[-1]) if of_cycles else "")
    assert balance["buckets"] == pytest.approx(sum(m.taken[-1][1]["bucket_kg"] for m in machines), rel=1e-12)
    assert machines[0].taken[-1][1]["bucket_kg"] > 100, "it keeps its last load"
    (x0, y0), (x1, y1) = area[0], area[2]
    inside = (x0 < x) & (x < x1) & (y0 < y) & (y < y1)
    undug_m3 = -DESIGN_M * ((x1 - x0) * (y1 - y0) - np.count_nonzero(inside) * cell_m2)
    above = np.where(inside, change - DESIGN_M, 0)   # of ground that was level at 0
    to_cut_m3, to_fill_m3 = np.maximum(above, 0).sum() * cell_m2 + undug_m3, np.maximum(-above, 0).sum() * cell_m2
    progress, = [area for area in server.json("/progress")["areas"] if area["id"] == pit["id"]]
    # It compares heights of the surface, which err by less than a hundredth of a voxel on average.
    error_m3 = VOXEL_M / 100 * np.count_nonzero(inside & (change != 0)) * cell_m2
    assert progress["to_cut_m3"] == pytest.approx(to_cut_m3, abs=error_m3)
    assert progress["to_fill_m3"] == pytest.approx(to_fill_m3, abs=error_m3)
    at_start_m3 = -DESIGN_M * (x1 - x0) * (y1 - y0)
    assert progress["done"] == pytest.approx(1 - (to_cut_m3 + to_fill_m3) / at_start_m3, abs=error_m3 / at_start_m3)


def require_other_times(server, machines, hours_s):
    """At the end of an hour, machines have done what they were answered until then."""
    for end_s in (hours_s[2], hours_s[3], hours_s[4]):   # the second is amid the times of the wrong clock
        rows = {row["machine"]: row for row in rows_of(server, f"/machines.csv?time={end_s - 1}")}
        for machine in machines:
            before = [answer for state, answer in machine.taken if state["time"] < end_s]
            row = rows[machine.name]
            if not before:
                assert row["state"] == "unseen" and float(row["cut_m3"]) == 0
                continue
            assert float(row["bucket_m3"]) == before[-1]["bucket_m3"]
            assert float(row["cut_m3"]) == sum(round(a["cut_m3"] / SAMPLE_M3) for a in before) * SAMPLE_M3
            assert int(row["cycles"]) == sum(
                of.cycles for hour, of in sums_of(machine).items() if hour < end_s), (machine.name, end_s)


def told(server):
    """All but whether a machine works now, which is of the clock on the wall."""
    machines = [{**row, "state": None} for row in rows_of(server, "/machines.csv")]
    return rows_of(server, "/report.csv"), machines, server.json("/summary.json")["state_hash"]


def test_a_day_of_five_machines_is_reported_as_it_was(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text(SITE)
    (tmp_path / "plan.asc").write_text(
        f"ncols 41\nnrows 61\nxllcenter -15\nyllcenter -15\ncellsize 1\n" + (f"{DESIGN_M} " * 41 + "\n") * 61)
    begin_s = (time.time() // HOUR_S - 8) * HOUR_S
    hours_s = [begin_s + HOUR_S * i for i in range(7)]
    with small_disk(tmp_path / "disk", 20_000) as disk:
        with Server(path, "--design", "plan.asc", "--out", disk / "out", cwd=tmp_path) as server:
            area = [[-1, -3], [4.4, -3], [4.4, 27], [-1, 27]]
            status, (pit,) = server.post("/measures", [{"add": {"kind": "boundary", "name": "Pit", "points": area}}])
            assert status == 200
            machines = asyncio.run(play(server, disk, hours_s))
            require_report(server, machines, begin_s)
            require_sums(server)
            require_ground(server, machines, tmp_path, pit, area)
            require_other_times(server, machines, hours_s)
            kept = told(server)
            page = server.get(f"/report?from={begin_s}&to={begin_s + 7 * HOUR_S}&every=86400")[1].decode()
            for row in table(server, "/report.csv").values():
                assert row["span"] == "period" or f"{float(row['cut_m3_bank']):.2f}" in page
            server.kill()
        with Server(disk / "out", cwd=tmp_path) as server:
            assert told(server) == kept, "the recording alone says the same"
