# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Measures with names stay, whatever happens; progress to the design is what volumes at earlier times say."""
import asyncio
import csv
import json
import random
import re
import subprocess
import threading

import numpy as np
import pytest
from live import Client, Server, scenario, view

KINDS = {"boundary": 4, "section": 2, "height": 1, "distance": 2}
HOUR_S = 3600


def points(rng, kind):
    x, y, size = rng.uniform(0, 3), rng.uniform(-1, 1), rng.uniform(0.5, 2)
    return [[x, y], [x + size, y], [x + size, y + size], [x, y + size]][:KINDS[kind]]


def kept(server):
    return {m["id"]: m for m in server.json("/measures")["measures"]}


def change(server, json_, status=200):
    got, answer = server.post("/measures", [json_])
    assert got == status, answer
    return answer[0]


@pytest.mark.parametrize("seed", range(2))
def test_measures_are_what_the_answered_changes_made_of_them(tmp_path, seed):
    rng, wanted, ids = random.Random(seed), {}, set()
    path = scenario(tmp_path)
    for _ in range(3):
        with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
            assert kept(server) == wanted
            for _ in range(20):
                kind, name = rng.choice(list(KINDS)), f"{rng.choice('äbc=')} {rng.randrange(12)}"
                taken = {m["name"]: id for id, m in wanted.items()}
                what = rng.choice(["add", "add", "change", "remove"])
                if what == "add":
                    given = {"kind": kind, "name": name, "points": points(rng, kind)}
                    answer = change(server, {"add": given}, 400 if name in taken else 200)
                    if name in taken:
                        assert "already" in answer["error"]
                        continue
                    assert answer["id"] not in ids, "numbers are never used again"
                    ids.add(answer["id"])
                    assert answer == wanted.setdefault(answer["id"], {"id": answer["id"], **given})
                elif ids:
                    id = rng.choice(sorted(ids))
                    if what == "remove":
                        change(server, {"remove": id}, 200 if id in wanted else 400)
                        wanted.pop(id, None)
                        continue
                    moved = points(rng, wanted[id]["kind"]) if id in wanted else []
                    given = rng.choice([{"name": name}, {"points": moved}, {"name": name, "points": moved}])
                    good = id in wanted and taken.get(given.get("name"), id) == id
                    change(server, {"change": {"id": id, **given}}, 200 if good else 400)
                    if good:
                        wanted[id].update(given)
            assert kept(server) == wanted
            server.kill() if rng.random() < 0.5 else server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        assert kept(server) == wanted, "the recording alone has them, too"
        assert "only be viewed" in change(server, {"remove": 1}, 403)["error"]


BAD = [
    ([], "not a JSON object"), ({}, "one of 'add', 'change' and 'remove'"),
    ({"add": 1}, "'add' must be an object"), ({"remove": 1, "add": {}}, "one of"),
    ({"remove": 7}, "there is no measure 7"), ({"remove": -1}, "'id' must be"), ({"remove": 1e30}, "'id' must be"),
    ({"change": {"name": "x"}}, "'id' must be"), ({"change": {"id": 9, "name": "x"}}, "no measure 9"),
    ({"add": {"kind": "circle", "name": "x", "points": []}}, "'kind' must be boundary, section, height or distance"),
    ({"add": {"kind": "height", "points": [[0, 0]]}}, "'name' must be"),
    ({"add": {"kind": "height", "name": "a\nb", "points": [[0, 0]]}}, "'name' must be"),
    ({"add": {"kind": "height", "name": 81 * "x", "points": [[0, 0]]}}, "1 to 80 bytes"),
    ({"add": {"kind": "height", "name": "x", "points": [[0, 0, 1]]}}, "'points' must be an array of 2 numbers"),
    ({"add": {"kind": "height", "name": "x", "points": [[0, 2e9]]}}, "within 1e+09 m"),
    ({"add": {"kind": "height", "name": "x", "points": [[-2e9, 0]]}}, "within 1e+09 m"),
    ({"add": {"kind": "height", "name": " mark ", "points": [[0, 0]]}}, "there is a measure 'mark' already"),
    ({"add": {"kind": "section", "name": "x", "points": [[0, 0]]}}, "of a section must be an array of 2 [x, y]"),
    ({"add": {"kind": "distance", "name": "x", "points": [[1, 1], [1, 1]]}}, "must differ"),
    ({"add": {"kind": "boundary", "name": "x", "points": [[0, 0], [2, 2], [2, 0], [0, 2]]}}, "crosses itself"),
    ({"add": {"kind": "boundary", "name": "x", "points": 1001 * [[0, 0]]}}, "3 to 1000"),
    ({"add": {"kind": "boundary", "name": "x", "points": [[0, 0], [1, 0]]}}, "3 to 1000"),
    ({"add": {"kind": "height", "name": "x", "points": [[0, 0]], "colour": "red"}}, "unknown key 'colour'"),
]


def test_bad_changes_are_told_and_change_nothing(tmp_path):
    file = tmp_path / "out/measures.json"
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        change(server, {"add": {"kind": "height", "name": "mark", "points": [[0, 0]]}})
        before = file.read_bytes()
        for bad, said in BAD:
            assert said in change(server, bad, 400)["error"]
        assert file.read_bytes() == before
        ring = [[np.cos(a), np.sin(a)] for a in np.linspace(0, 6, 1000)]
        for i in range(9):
            change(server, {"add": {"kind": "boundary", "name": f"ring {i}", "points": ring}})
        assert "10000 points in all" in change(
            server, {"add": {"kind": "boundary", "name": "one more", "points": ring}}, 400)["error"]
        change(server, {"add": {"kind": "boundary", "name": "the last", "points": ring[:999]}})
        assert len(kept(server)) == 11
        for measure, said in (("2", "there is no design"), ("1", "of a measure with a boundary"),
                              ("99", "there is no measure 99"), ("0.5", "there is no measure"), ("x", "'measure'")):
            assert said in json.loads(server.get(f"/progress?measure={measure}")[1])["error"]
        server.stop()
    for text in ('{"measures": [{"id": 1}]}', "[]", '{"next": 1, "measures": [{"id": 1, "kind": "height", '
                 '"name": "a", "points": [[0, 0]]}]}', "\x00", json.dumps({"next": 3, "measures": [
                     {"id": 1, "kind": "height", "name": name, "points": [[0, 0]]} for name in "ab"]})):
        file.write_text(text)
        with pytest.raises(AssertionError, match="measures.json"):
            Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path)
        assert file.read_text() == text


def test_a_site_keeps_200_measures(tmp_path):
    marks = [{"id": id, "kind": "height", "name": f"{id}", "points": [[0, 0]]} for id in range(1, 201)]
    more = {"add": {"kind": "height", "name": "more", "points": [[0, 0]]}}
    (tmp_path / "out").mkdir()
    (tmp_path / "out/measures.json").write_text(json.dumps({"next": 201, "measures": marks}))
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert "at most 200 measures" in change(server, more, 400)["error"]
        change(server, {"remove": 7})
        assert change(server, more)["id"] == 201 and len(kept(server)) == 200


def test_who_may_only_look_changes_no_measures_and_sees_those_of_others(tmp_path):
    env = {"SOILVDB_TOKEN": "digs", "SOILVDB_VIEW_TOKEN": "looks"}
    mark = {"add": {"kind": "height", "name": "mark", "points": [[0, 0]]}}
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path, env=env) as server:
        assert server.post("/measures", [mark])[0] == 401
        assert server.post("/measures?token=looks", [mark])[0] == 403
        for path in ("/measures", "/measures.geojson", "/measures.csv"):
            assert server.get(path)[0] == 401 and server.get(path + "?token=looks")[0] == 200

        def lists(texts):
            return [t for t in texts if t["type"] == "measures"]

        async def look(token):
            texts = []
            async with server.connect(f"/view?token={token}") as socket:
                async def until(count):
                    while len(lists(texts)) < count:
                        message = await socket.recv()
                        if isinstance(message, str):
                            texts.append(json.loads(message))
                await asyncio.wait_for(until(1), 60)
                await asyncio.to_thread(server.post, "/measures?token=digs", [mark | {}])
                await asyncio.wait_for(until(2), 60)
            return lists(texts)
        first, second = asyncio.run(look("looks"))
        assert first["measures"] == [] and not first["may_change"] and first["link_token"] == "looks"
        assert [m["name"] for m in second["measures"]] == ["mark"] and not second["may_change"]
        texts, _ = asyncio.run(view(server, lambda texts, _: lists(texts), path="/view?token=digs"))
        assert lists(texts)[0]["may_change"] and lists(texts)[0]["link_token"] == "looks", "never the token of feeds"


VOXEL_M, DEPTH_M = 0.25, 1.0


def raster(path, heights):
    """Writes cells of 1 m from 500100, 5400200. @param heights rows from the south"""
    plain = path.with_suffix(".asc")
    plain.write_text("ncols 40\nnrows 40\nxllcorner 500100\nyllcorner 5400200\ncellsize 1\nNODATA_value -9999\n" +
                     "\n".join(" ".join(str(z) for z in row) for row in np.nan_to_num(heights[::-1], nan=-9999)))
    subprocess.run(["gdal_translate", "-q", "-a_srs", "EPSG:25832", plain, path], check=True)
    return path


@pytest.fixture(name="site")
def _site(tmp_path):
    """40 m x 40 m of level ground at 10 m; the design is DEPTH_M lower, and ends in its middle."""
    raster(tmp_path / "ground.tif", np.full((40, 40), 10.0))
    design = np.full((40, 40), 10.0 - DEPTH_M)
    design[:, 20:] = np.nan
    raster(tmp_path / "design.tif", design)
    path = tmp_path / "site.yaml"
    path.write_text(f"soilvdb: 1\nvoxel_size: {VOXEL_M}\nterrain: {{raster: ground.tif}}\n"
                    "output: {journal: {sync: always}}\n"
                    "machines: [{name: d, bucket: {width: 2.0, height: 1.0}}]\n")
    return path


def served(site):
    return Server(site, "--design", site.parent / "design.tif", "--out", site.parent / "out", cwd=site.parent)


def strips(begin_s, every_s, first, count):
    """A strip of 2 m x 8 m is dug down to the design in each `every_s`, with a state each 45 s or sooner."""
    steps = max(9, int(every_s / 45))
    for k in range(first, first + count):
        at = [(500104.0 + 8 * i / (steps - 2), 10.0 - DEPTH_M) for i in range(steps - 1)] + [(500112.0, 12.0)]
        for i, (x, z) in enumerate(at):
            yield {"machine": "d", "time": begin_s + every_s * (k - first + i / steps),
                   "position": [x, 5400204.0 + 2 * k, z], "rotation": [0, 0, 0, 1]}


def feed(server, states):
    answers = server.feed(list(states))
    assert not [answer for answer in answers if "error" in answer], answers


def feed_slowly(server, states, out, every_s=300):
    """As a machine would: each snapshot is written before the next one is due."""
    async def work():
        async with server.connect("/feed") as socket:
            async def tell(state):
                await socket.send(json.dumps(state))
                assert "error" not in json.loads(await socket.recv())
            due_s = None
            for state in states:
                before = set(out.glob("soil_*.vdb"))
                await tell(state)
                while due_s is not None and state["time"] >= due_s and set(out.glob("soil_*.vdb")) <= before:
                    await asyncio.sleep(0.005)
                    await tell(state)   # it waits for the one before to be on disk
                due_s = every_s * (state["time"] // every_s + 1)
    asyncio.run(asyncio.wait_for(work(), 60))


def area(server, name, x0=500104, y0=5400203, x1=500112, y1=5400219):
    corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    return change(server, {"add": {"kind": "boundary", "name": name, "points": corners}})


def volume(server, of, more=""):
    return server.json("/volume?boundary=" + ",".join(f"{v}" for p in of["points"] for v in p) + more)


def progress(server, of):
    return server.json(f"/progress?measure={of['id']}")["areas"][0]


def worked_h(server, from_s, to_s):
    """Of the one machine, in whole minutes, as the report has it."""
    rows = csv.DictReader(server.get("/report.csv?every=60")[1].decode().splitlines())
    return sum(float(row["working_s"]) for row in rows if row["machine"] == "d" and row["span"] == "period"
               and from_s <= float(row["from_s"]) < to_s) / HOUR_S


def require_progress(server, of):
    """What is left is that of /volume at each time; rate and end follow from it and from the report's hours."""
    told, now = progress(server, of), volume(server, of)
    times, cut = told["over_time"]["time_s"], told["over_time"]["to_cut_m3"]
    assert times == sorted(set(times))
    earlier = list(zip(times, cut, told["over_time"]["to_fill_m3"]))[1:-1]
    for time_s, to_cut, to_fill in random.Random(1).sample(earlier, min(6, len(earlier))):
        there = volume(server, of, f"&time={time_s}")
        assert (to_cut, to_fill) == (there["to_cut_m3"], there["to_fill_m3"])
    assert (cut[-1], told["to_cut_m3"]) == (now["to_cut_m3"], now["to_cut_m3"])
    assert (told["over_time"]["to_fill_m3"][-1], told["to_fill_m3"]) == (now["to_fill_m3"], now["to_fill_m3"])
    assert cut[0] == pytest.approx(now["design_area_m2"] * DEPTH_M)
    assert told["done"] == pytest.approx(1 - (cut[-1] + told["to_fill_m3"]) / cut[0])
    return told


def test_progress_is_what_volumes_at_earlier_times_say(site):
    with served(site) as server:
        of, none = area(server, "pit"), area(server, "elsewhere", 500125, 5400203, 500135, 5400219)
        later = area(server, "later", 500104, 5400225, 500112, 5400235)
        assert progress(server, none)["error"] == "the design has no heights in this area"
        fresh = progress(server, of)
        assert fresh["done"] == 0 and fresh["rate_m3_per_h"] is None and "no state had a time" in fresh["note"]
        feed_slowly(server, strips(600.0, 960, 0, 4), site.parent / "out")
        told = require_progress(server, of)
        assert len(told["over_time"]["time_s"]) >= 10
        # 8 strips were to be dug, and half of them are: 8 m x 8 m x 1 m in about an hour.
        assert told["done"] == pytest.approx(0.5, abs=0.06)
        now_s, over_h = told["over_time"]["time_s"][-1], told["rate_over_h"]
        assert over_h == pytest.approx(worked_h(server, 0, now_s), abs=1e-4)
        assert progress(server, later)["note"].startswith("what is left has not become less in the last 1")
        at_start = told["at_start"]["to_cut_m3"]
        assert told["rate_m3_per_h"] * over_h == pytest.approx(at_start - told["to_cut_m3"] - told["to_fill_m3"])
        assert told["left_h"] == pytest.approx((told["to_cut_m3"] + told["to_fill_m3"]) / told["rate_m3_per_h"])
        assert told["end_s"] == pytest.approx(now_s + HOUR_S * told["left_h"])
        assert told["note"] == "if work goes on without a break"
        page = server.get("/report")[1].decode()
        assert "Progress to design" in page and "Expected end" in page
        assert set(cells(page, "elsewhere").values()) == {"–"}
        server.stop()
    with Server(site.parent / "out", "--design", site.parent / "design.tif", cwd=site.parent) as server:
        again = progress(server, of)
        assert again["over_time"] == told["over_time"] and again["end_s"] == told["end_s"]


def test_days_of_work_tell_how_long_days_of_work_are(site):
    day_s, begin_s = 86400, 1.7e9
    with served(site) as server:
        of = area(server, "pit")
        for day in range(3):   # an hour of work each
            states = list(strips(begin_s + day_s * day, 1800, 2 * day, 2))
            server.feed(states[:1])   # refused once: it is hours later
            feed(server, states)
        told = require_progress(server, of)
        now_s = told["over_time"]["time_s"][-1]
        days = int((now_s - begin_s) // day_s)
        share = worked_h(server, now_s - day_s * days, now_s + 60) / (24 * days)
        assert told["end_s"] - now_s == pytest.approx(HOUR_S * told["left_h"] / share, rel=0.05)
        assert told["end_s"] > now_s + day_s / 4 and "of each day are worked" in told["note"]
        feed(server, strips(now_s + 60, 1800, 6, 2))
        done = progress(server, of)
        assert done["note"].startswith("the design is reached") and done["end_s"] is None and done["done"] > 0.98


def test_what_was_dug_before_the_first_time_is_not_of_its_rate(site):
    with served(site) as server:
        of = area(server, "pit")
        feed(server, [{key: state[key] for key in state if key != "time"} for state in strips(0.0, 960, 4, 1)])
        feed(server, strips(600.0, 960, 0, 1))
        told = progress(server, of)
        first_s, first_m3 = (told["over_time"][key][0] for key in ("time_s", "to_cut_m3"))
        assert first_m3 == volume(server, of, f"&time={first_s}")["to_cut_m3"]
        # The way down to the first state with a time is another 3 m x 2 m, 0.5 m deep on average.
        assert 16 * DEPTH_M <= told["at_start"]["to_cut_m3"] - first_m3 < 19


def snapshots_each(site, every_s):
    site.write_text(site.read_text().replace("sync: always}", f"sync: always}}, snapshots: {{every: {every_s}}}"))


@pytest.mark.parametrize("every_s", [120, 1800])
def test_few_earlier_grounds_are_dug_again_and_none_for_long(site, every_s):
    snapshots_each(site, every_s)
    with served(site) as server:
        of = area(server, "pit")
        states = list(strips(1800.0, 900, 0, 3))
        feed_slowly(server, states, site.parent / "out", every_s)
        times = require_progress(server, of)["over_time"]["time_s"]
        snapshots = [min(s["time"] for s in states if s["time"] >= due_s) for due_s in range(1800, 4400, every_s)]
        dug = [time_s for time_s in times[1:-1] if time_s not in snapshots]
        assert 0 < len(dug) <= 12
        assert all(time_s - max(s for s in snapshots if s <= time_s) <= 600 for time_s in dug)


def test_what_is_told_of_the_end_grows_with_work(site):
    site.write_text(site.read_text().replace("machines: [", "machines: [{name: e, bucket: {width: 2.0, height: 1.0}}, "))
    snapshots_each(site, HOUR_S)
    day_s, begin_s = 86400, 472222.0 * HOUR_S
    # Of the second, hardly anything is dug.
    bounds = (500101, 5400201, 500118, 5400239), (500101, 5400216.998, 500118, 5400239)

    def both(states):
        """Another machine works beside it: hours of the site are those of one."""
        for state in states:
            x, y, _ = state["position"]
            yield state
            yield {**state, "machine": "e", "position": [x + 10, y, 15.0]}
    with served(site) as server:
        of, hardly = (area(server, f"{corners}", *corners) for corners in bounds)
        hour = list(both(strips(begin_s, HOUR_S, 0, 1)))
        feed(server, hour[:4])
        told = progress(server, of)
        assert told["note"] == "machines have worked less than a minute" and told["rate_m3_per_h"] is None
        feed(server, hour[4:24])
        told = require_progress(server, of)
        assert told["note"].endswith("min of work is too little to tell the end; 30 min is needed")
        assert told["rate_m3_per_h"] > 0 and told["left_h"] is None
        feed_slowly(server, [*hour[24:], *both(strips(begin_s + HOUR_S, HOUR_S, 1, 5))], site.parent / "out", HOUR_S)
        told = require_progress(server, of)
        assert told["left_h"] > 24 and told["end_s"] is None
        assert told["note"] == "hours of work per day are known after a day"
        now_s, over_h = told["over_time"]["time_s"][-1], told["rate_over_h"]
        assert 4 <= over_h < 5.2
        left_m3 = np.add(told["over_time"]["to_cut_m3"], told["over_time"]["to_fill_m3"])
        dug_m3 = [m3 - left_m3[-1] for time_s, m3 in zip(told["over_time"]["time_s"], left_m3)
                  if abs(worked_h(server, time_s // 60 * 60, now_s) - over_h) < 0.02]
        assert told["rate_m3_per_h"] * over_h in [pytest.approx(m3) for m3 in dug_m3]
        states = list(strips(begin_s + day_s, HOUR_S, 6, 1))
        server.feed(states[:1])   # refused once: it is hours later
        feed(server, states)
        assert "of each day are worked, as in the last 24 h" in require_progress(server, of)["note"]
        told = progress(server, hardly)
        assert told["note"] == "at this rate it takes more than five years" and told["end_s"] is None


def cells(page, name):
    """Of an area's row in the report."""
    row = re.search(f'<th scope="row">{name}</th>(.*?)</tr>', page).group(1)
    return dict(re.findall('<td data-name="([^"]*)">([^<]*)</td>', row))


def test_the_report_draws_progress(site):
    design = np.full((40, 40), 10.5)
    design[:, :10] = 10.0 - DEPTH_M
    raster(site.parent / "design.tif", design)
    snapshots_each(site, 1000000)   # none comes between the figures and the page
    with served(site) as server:
        of = area(server, "pit", x1=500118)
        feed(server, strips(600.0, 300, 0, 1))
        figure = re.search("<figcaption>pit.*?</figure>", server.get("/report")[1].decode()).group()
        assert re.findall('text-anchor="(?:middle|end)">([0-9]+:[0-9]+)<', figure) == ["0:00", "2:13", "4:26"]
        feed(server, strips(900.0, 1200, 1, 3))
        told, now = progress(server, of), volume(server, of)
        assert told["to_fill_m3"] == now["to_fill_m3"]
        assert told["at_start"]["to_cut_m3"] > 1.2 * told["at_start"]["to_fill_m3"] > 0
        page = server.get("/report?units=yd3")[1].decode()
        row, yard_m3 = cells(page, "pit"), 0.9144 ** 3
        for name, wanted in (("Still to cut, yd³", told["to_cut_m3"]), ("Still to fill, yd³", told["to_fill_m3"]),
                             ("Rate, yd³/h", told["rate_m3_per_h"])):
            shown = float(row[name])
            assert shown == pytest.approx(wanted / yard_m3, abs=0.501 if shown >= 100 else 0.0501), name
        assert row["Done"] == f"{100 * told['done']:.0f} %"
        assert float(row["Work left, h"]) == pytest.approx(told["left_h"], abs=0.051)

        def clock(time_s):
            return f"{int(time_s) // 3600}:{int(time_s) // 60 % 60:02}"
        times = told["over_time"]["time_s"]
        assert row["Expected end"] == clock(told["end_s"]) + " h:min"
        assert f"As of {clock(times[-1])} h:min, whatever" in page
        figure = re.search("<figcaption>pit, yd³.*?</figure>", page).group()
        ticks = [times[0], (times[0] + times[-1]) / 2, times[-1]]
        assert re.findall('text-anchor="(?:middle|end)">([0-9]+:[0-9]+)<', figure) == [clock(time_s) for time_s in ticks]
        lines = [np.array([float(v) for v in re.findall("[0-9.]+", path)]).reshape(-1, 2)
                 for path in re.findall('<path d="([^"]*)" fill="none"', figure)]
        assert re.findall("</svg>(Still[^<]*)</li>", figure) == ["Still to fill", "Still to cut"]
        shown = np.array([170 - line[:, 1] for line in lines])   # above the axis
        wanted = np.array([told["over_time"]["to_fill_m3"], told["over_time"]["to_cut_m3"]])
        np.testing.assert_allclose(shown / shown.max(), wanted / wanted.max(), atol=0.002)


def test_progress_follows_the_past_and_the_area(site):
    with served(site) as server:
        of, states = area(server, "pit"), list(strips(600.0, 1900, 0, 2))
        feed_slowly(server, states, site.parent / "out")
        progress(server, of)
        assert server.post("/undo?machine=d&time=2400")[0] == 200
        require_progress(server, of)
        elsewhere = [(state, state["position"]) for state in states if state["time"] > 2400]
        feed_slowly(server, [{**state, "position": [x, y + 6, z]} for state, (x, y, z) in elsewhere], site.parent / "out")
        require_progress(server, of)
        half = [[500104, 5400203], [500112, 5400203], [500112, 5400206], [500104, 5400206]]
        require_progress(server, change(server, {"change": {"id": of["id"], "points": half}}))


def test_others_are_answered_between_the_grounds_that_progress_looks_at(site):
    with served(site) as server:
        of = area(server, "pit")
        feed(server, strips(600.0, 900, 0, 8))
        order = []

        def ask(name, path):
            status, _ = Client(server.url).get(path, {"X-Forwarded-For": name})
            order.append((name, status))
        slow = threading.Thread(target=ask, args=("office", f"/progress?measure={of['id']}"))
        slow.start()
        ask("driver", "/height?x=500105&y=5400205&time=5000")
        slow.join()
        assert order == [("driver", 200), ("office", 200)]


def test_exports_have_names_places_and_values(site, tmp_path):
    with served(site) as server:
        feed(server, strips(600.0, 60, 0, 2))
        made = [area(server, 'pit, "north"')]
        clockwise = change(server, {"add": {"kind": "boundary", "name": "clockwise", "points": made[0]["points"][::-1]}})
        made.append({**clockwise, "points": clockwise["points"][::-1]})   # rings go counter-clockwise
        for kind, at in (("section", [[500104, 5400204], [500112, 5400208]]), ("height", [[500105.5, 5400204]]),
                         ("distance", [[500105, 5400204], [500105, 5400230]]),
                         ("distance", [[500105, 5400230], [500105, 5400250]])):
            made.append(change(server, {"add": {"kind": kind, "name": f"{kind} {len(made)}", "points": at}}))
        (tmp_path / "measures.geojson").write_bytes(server.get("/measures.geojson")[1])
        read = subprocess.run(["ogr2ogr", "-f", "CSV", "/vsistdout/", tmp_path / "measures.geojson", "-lco",
                               "GEOMETRY=AS_WKT"], check=True, capture_output=True, text=True).stdout
        rows = list(csv.DictReader(read.splitlines()))
        assert [(row["name"], row["kind"]) for row in rows] == [(m["name"], m["kind"]) for m in made]
        numbers = [[float(v) for v in re.findall(r"[\d.]+", row["WKT"])] for row in rows]
        rings = [[v for p in m["points"] + m["points"][:1] for v in p] for m in made[:2]]
        assert numbers == [*rings, *([v for p in m["points"] for v in p] for m in made[2:])]
        assert [row["WKT"].split()[0] for row in rows] == ["POLYGON"] * 2 + ["LINESTRING", "POINT"] + ["LINESTRING"] * 2
        crs = subprocess.run(["ogrinfo", "-al", "-so", tmp_path / "measures.geojson"], check=True, capture_output=True, text=True)
        assert "25832" in crs.stdout
        rows = list(csv.DictReader(server.get("/measures.csv")[1].decode().splitlines()))
        wanted = volume(server, made[0])
        for key in ("cut_m3", "fill_m3", "area_m2", "to_cut_m3", "to_fill_m3"):
            assert float(rows[0][key]) == wanted[key]
        section = server.json("/section?from=500104,5400204&to=500112,5400208&points=500")
        assert float(rows[2]["cut_m2"]) == section["cut_m2"] and not rows[2]["cut_m3"]
        assert float(rows[2]["length_m"]) == pytest.approx(np.hypot(8, 4))
        height = server.json("/height?x=500105.5&y=5400204")
        assert {key: float(rows[3][key]) for key in height} == height
        level_m, rise_m, slope_m = (float(rows[4][key]) for key in ("level_m", "rise_m", "slope_m"))
        assert level_m == 26 and rise_m == pytest.approx(DEPTH_M, abs=VOXEL_M)
        assert slope_m == pytest.approx(np.hypot(level_m, rise_m))
        assert float(rows[5]["level_m"]) == 20, "one end is beyond the ground"
        assert rows[5]["rise_m"] == rows[5]["slope_m"] == rows[5]["error"] == ""
        at_start = list(csv.DictReader(server.get("/measures.csv?time=500")[1].decode().splitlines()))
        assert float(at_start[0]["cut_m3"]) == 0 < float(rows[0]["cut_m3"])


def test_places_of_an_export_are_those_of_the_map(site):
    subprocess.run(["gdal_translate", "-q", "-a_srs", "EPSG:25832+5783", "ground.tif", "heights.tif"], cwd=site.parent, check=True)
    site.write_text(site.read_text().replace("ground.tif", "heights.tif"))
    with Server(site, "--out", site.parent / "out", cwd=site.parent) as server:
        area(server, "pit")
        assert server.json("/measures.geojson")["crs"]["properties"]["name"] == "urn:ogc:def:crs:EPSG::25832"
