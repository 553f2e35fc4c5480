# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Surveys as new ground, by POST, while machines are fed."""
import asyncio
import http.client
import json
import math
import re
import signal
import socket
import struct
import subprocess
import threading
import zlib
from urllib.parse import urlsplit

import numpy as np
import pytest
import soilvdb
from live import Server, passes, scenario, state_told, until
from test_disk import fill, small_disk
from test_sigmas import Sigmas

VOXEL = 0.25
CELL = 0.5
SIDE = 80  # posts


def surface(level=0.0, waves=0.3):
    """Heights of posts from (100.25, 200.25), rows from the south."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] * CELL
    rough = waves * np.sin(0.4 * x) * np.cos(0.3 * y)
    rough[[0, 1, -2, -1]] = rough[:, [0, 1, -2, -1]] = 0  # only whole columns of voxels are taken
    return (10 + level + rough).astype(np.float32)


def tif(path, heights, crs="EPSG:25832", first=(100.25, 200.25), options=()):
    plain = path.with_name("plain.tif")
    soilvdb.write_raster(plain, np.asarray(heights, np.float32), first, (CELL, CELL))
    subprocess.run(["gdal_translate", "-q", *(["-a_srs", crs] if crs else []), *options, plain, path], check=True)
    return path.read_bytes()


def landxml(heights, step=8):
    """A surface of every so many posts."""
    rows = range(0, SIDE, step)
    points, faces = [], []
    for j in rows:
        for i in rows:
            points.append(f'<P id="{len(points) + 1}">{200.25 + CELL * j} {100.25 + CELL * i} {heights[j, i]}</P>')
    n = len(rows)
    for j in range(n - 1):
        for i in range(n - 1):
            a = j * n + i + 1
            faces += [f"<F>{a} {a + 1} {a + n}</F>", f"<F>{a + 1} {a + n + 1} {a + n}</F>"]
    return ('<?xml version="1.0"?><LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">'
            '<Units><Metric linearUnit="meter"/></Units><Surfaces><Surface name="morning"><Definition '
            f'surfType="TIN"><Pnts>{"".join(points)}</Pnts><Faces>{"".join(faces)}</Faces>'
            "</Definition></Surface></Surfaces></LandXML>").encode()


@pytest.fixture(name="site")
def _site(tmp_path):
    """40 m x 40 m of level ground at 10 m, from (100, 200)."""
    tif(tmp_path / "ground.tif", surface(waves=0))
    path = tmp_path / "site.yaml"
    path.write_text(f"soilvdb: 1\nvoxel_size: {VOXEL}\nterrain: {{raster: ground.tif}}\n"
                    "machines: [{name: digger, bucket: {width: 2.0, height: 1.0}}]\n"
                    "soil: {repose_angle: 0.6, swell: 0.2}\noutput: {journal: {sync: always}}\n")
    return path


def served(site, *more):
    return Server(site, *more, "--out", site.parent / "out", cwd=site.parent)


def post(server, data, query="", headers=None):
    status, body = server.get("/survey" + query, headers, "POST", data)
    return status, json.loads(body)


def take(server, data, query=""):
    status, answer = post(server, data, query)
    assert status == 200, answer
    return answer


def send(server, data):
    """To a server that is killed meanwhile."""
    try:
        post(server, data)
    except (OSError, http.client.HTTPException):
        pass


def dig(server, begin=0.0, y=220.0, depth=0.6):
    states = []
    for state in passes("digger", y, depth, 40, begin):
        x, _, z = state["position"]
        states.append({**state, "position": [110 + x, y, 10 + z]})
    assert all("error" not in answer for answer in server.feed(states))


def digest(server):
    return server.json("/summary.json")["state_hash"]


def height(server, x, y, more=""):
    return server.json(f"/height?x={x}&y={y}{more}")["height_m"]


def integral(heights, before=10.0, low=(100.25, 200.25), high=(139.75, 239.75)):
    """Volume between posts and a level, bilinear, over a rectangle of whole cells: the trapezoid rule is exact."""
    i0, i1 = (round((v - 100.25) / CELL) for v in (low[0], high[0]))
    j0, j1 = (round((v - 200.25) / CELL) for v in (low[1], high[1]))
    d = heights[j0:j1 + 1, i0:i1 + 1].astype(float) - before
    return CELL ** 2 * (d[:-1, :-1] + d[1:, :-1] + d[:-1, 1:] + d[1:, 1:]).sum() / 4


# Errors of counts, 0.022 of a cell each in some two cells of a column, before and after.
NOISE_M3 = 4 * 0.022 * VOXEL ** 3 * math.sqrt(2 * 2 * (39.5 / VOXEL) ** 2)


def test_a_survey_is_the_ground_and_no_work(site, tmp_path):
    heights = surface()
    with served(site) as server:
        dig(server)
        before = server.json("/summary.json")
        assert state_told(server)["surveyed_m3"] is None
        machine = server.json("/machines")["machines"][0]
        answer = take(server, tif(tmp_path / "m.tif", heights))
        assert 39 ** 2 <= answer["area_m2"] <= 39.5 ** 2 and answer["warnings"] == []
        assert answer["voids"] == 0 and answer["outside"] == 0
        assert answer["acknowledged_s"] == pytest.approx(0.39)
        after = server.json("/summary.json")
        volumes = after["volume_m3"]
        assert volumes["surveyed_removed"] == pytest.approx(answer["removed_m3"])
        assert volumes["surveyed_added"] == pytest.approx(answer["added_m3"])
        assert after["mass_kg"]["residual"] == 0 and after["mass_kg"]["surveyed"] != 0
        told = state_told(server)
        assert told["surveyed_m3"] == pytest.approx(answer["added_m3"] - answer["removed_m3"])
        assert told["change_m3"] == pytest.approx(volumes["ground_change"])
        for kept in ("cut", "captured", "spilled", "fill"):
            assert volumes[kept] == before["volume_m3"][kept], kept
        assert server.json("/machines")["machines"][0]["bucket_m3"] == machine["bucket_m3"]
        # The ground is that of the posts, however it was dug before.
        change = volumes["ground_change"]
        assert change == pytest.approx(integral(heights), abs=NOISE_M3)
        x = np.arange(105, 135, 3.0)
        z = [height(server, a, 220.25) for a in x]
        wanted = [heights[40, round((a - 100.25) / CELL)] for a in x]
        assert np.abs(np.subtract(z, wanted)).max() < VOXEL / 4
        # The same again changes nothing.
        hashed = digest(server)
        again = take(server, (tmp_path / "m.tif").read_bytes())
        assert again["removed_m3"] == again["added_m3"] == again["changed_m2"] == 0
        assert digest(server) == hashed
        dig(server, 1.0)
        assert server.json("/summary.json")["mass_kg"]["residual"] == 0


def test_triangles_of_landxml_are_taken_by_their_name(site):
    heights = surface()
    with served(site) as server:
        status, answer = post(server, landxml(heights), "?surface=evening")
        assert status == 400 and "morning" in answer["error"] and "/tmp" not in answer["error"]
        answer = take(server, landxml(heights), "?surface=morning")
        # The terrain has a CRS and this file none.
        assert len(answer["warnings"]) == 1 and "names none" in answer["warnings"][0]
        assert height(server, 112.25, 216.25) == pytest.approx(heights[32, 24], abs=0.02)


def sparse(share):
    """So much of it is ground, and the rest zeros that nobody declared to be voids."""
    heights = surface()
    heights[round(share * SIDE):] = 0
    return heights


def test_some_zeros_are_told(site, tmp_path):
    with served(site) as server:
        warnings = take(server, tif(tmp_path / "m.tif", sparse(0.8)))["warnings"]
        told = re.search(r"(\d+) % of the survey are more than 5 m below the ground", "".join(warnings))
        assert told and 18 <= int(told[1]) <= 22, warnings
        assert not any("/tmp" in w or str(tmp_path) in w for w in warnings), warnings


def test_voids_and_boundaries_leave_the_ground(site, tmp_path):
    heights = surface(level=-1)
    heights[:, 40:] = np.nan
    with served(site) as server:
        data = tif(tmp_path / "m.tif", heights)
        answer = take(server, data, "?boundary=105.1,205.1,115.1,205.1,115.1,215.1,105.1,215.1")
        assert answer["area_m2"] == pytest.approx(100) and answer["voids"] == 0
        assert height(server, 110, 210) < 9.5 and height(server, 110, 220) == pytest.approx(10)
        answer = take(server, data)
        assert answer["voids"] == pytest.approx(0.5, abs=0.02)
        assert height(server, 130, 210) == pytest.approx(10)
        # A part of it is beyond the terrain.
        answer = take(server, tif(tmp_path / "e.tif", surface(), first=(120.25, 200.25)))
        assert answer["outside"] == pytest.approx(0.5, abs=0.02)


def test_what_a_survey_told_is_seen_until_it_is_dug(site, tmp_path):
    with served(site) as server:
        dig(server)
        assert Sigmas(server).m.size == 0
        area_m2 = take(server, tif(tmp_path / "m.tif", surface()))["area_m2"]
        told = Sigmas(server)
        assert told.cell == VOXEL and told.seen.sum() * told.cell ** 2 == pytest.approx(area_m2)
        assert told.m[told.seen].min() == pytest.approx(0.010) and np.median(told.m[told.seen]) < 0.011, "as of terrain"
        dig(server, 1.0)
        now = Sigmas(server)
        lost = told.seen & ~now.seen
        assert 4 * 2 <= lost.sum() * told.cell ** 2 < 20, "the pass and what slid there"
        assert np.all(abs(now.y[lost] - 220) < 3)


def test_what_was_before_and_after_it_is_kept_and_survives_a_kill(site, tmp_path):
    area = "/volume?boundary=105,205,135,205,135,235,105,235"
    data = tif(tmp_path / "m.tif", surface(-0.5))
    with served(site) as server:
        dig(server)
        take(server, data)
        dig(server, 2.0, 225.0)
        hashed, live = digest(server), server.json(area)
        server.kill()
    with served(site) as server:
        assert digest(server) == hashed
        assert server.json(area) == live
        before, after = server.json(area + "&time=0.3"), server.json(area + "&time=1")
        assert before["cut_m3"] < 5 and after["cut_m3"] > 400
        # A state before it is taken back, and the survey stays.
        assert server.json("/undo?machine=digger&time=0.2")["others"] == 0, "squares of a survey are no states"
        status, (answer,) = server.post("/undo?machine=digger&time=0.2")
        assert status == 200 and answer["states"] > 40
        undone = server.json(area)
        assert undone["cut_m3"] == pytest.approx(after["cut_m3"], rel=1e-6)
        assert server.json("/summary.json")["mass_kg"]["residual"] == 0
        assert subprocess.run([server.process.args[0], "verify", site.parent / "out"],
                              capture_output=True).returncode == 0


def test_viewers_and_feeds_go_on_meanwhile(site, tmp_path):
    async def look(server, data):
        async with server.connect("/view") as view, server.connect("/feed") as feed:
            blocks, told = set(), 0
            loop = asyncio.get_running_loop()
            work = loop.run_in_executor(None, take, server, data)
            n = 0
            while not work.done():
                await feed.send(json.dumps({"machine": "digger", "time": 0.01 * n, "position": [110, 220, 14],
                                            "rotation": [0, 0, 0, 1]}))
                told += "error" not in json.loads(await feed.recv())
                n += 1
            answer = await work
            while len(blocks) < 25:  # of 8 m x 8 m
                message = await asyncio.wait_for(view.recv(), 30)
                if isinstance(message, bytes):
                    blocks.add(struct.unpack_from("<ii", zlib.decompress(message)))
            return answer, told
    with served(site) as server:
        answer, told = asyncio.run(look(server, tif(tmp_path / "m.tif", surface())))
        assert told > 0 and answer["changed_m2"] > 1000


@pytest.mark.parametrize("make, said", [
    (lambda f: tif(f, surface(), crs="EPSG:25833"), "gdalwarp -t_srs EPSG:25832"),
    (lambda f: tif(f, surface(), first=(900_000.0, 200.25)), "misses the site"),
    (lambda f: tif(f, surface(47.3)), "above the same zero"),
    (lambda f: tif(f, sparse(0.4)), "no voids"),
    (lambda f: tif(f, sparse(0.08)), "% of the survey are more than 5 m below"),
    (lambda f: tif(f, surface() / 0.3048), "feet"),
    (lambda f: tif(f, surface(), crs="EPSG:4326"), "survey.tif"),
    (lambda f: tif(f, surface(), options=("-a_nodata", "10")) and tif(f, np.full((SIDE, SIDE), np.nan)), "no height"),
    (lambda f: tif(f, surface())[:20000], "damaged"),
    (lambda f: b"\x89PNG\r\n\x1a\n" + bytes(500), "the body is no survey; it must be a GeoTIFF"),
    (lambda f: b"<?xml version='1.0'?><gpx/>", "survey.xml"),
    (lambda f: b"--x\r\nContent-Disposition: form-data\r\n", "--data-binary"),
    (lambda f: b"", "no body"),
])
def test_what_can_not_be_the_ground_is_refused_in_a_line(site, tmp_path, make, said):
    with served(site) as server:
        hashed = digest(server)
        status, answer = post(server, make(tmp_path / "bad.tif"))
        assert status == 400 and said in answer["error"] and "\n" not in answer["error"]
        assert "/tmp" not in answer["error"] and str(tmp_path) not in answer["error"]
        assert digest(server) == hashed
        for query in ("?boundary=1,2,3", "?boundary=110,210,120,220,120,210,110,220", "?time=1", "?heights=ok", "?any=1"):
            status, answer = post(server, tif(tmp_path / "m.tif", surface()), query)
            assert status == 400, query
            assert digest(server) == hashed
        assert take(server, tif(tmp_path / "m.tif", surface(47.3)), "?heights=trusted")["warnings"]
        assert height(server, 120, 220) > 50


def told(server):
    """The progress of the only area."""
    return server.json("/progress")["areas"][0]


def test_many_posts_take_little_memory(site, tmp_path):
    """A sparse file of some kB has 400 MB of heights on this site."""
    subprocess.run(["gdal_create", "-q", "-of", "GTiff", "-outsize", "10000", "10000", "-bands", "1", "-ot", "Float32",
                    "-co", "SPARSE_OK=TRUE", "-co", "TILED=YES", "-a_srs", "EPSG:25832",
                    "-a_ullr", "100", "240", "140", "200", tmp_path / "sparse.tif"], check=True)
    with served(site) as server:
        before = server.rss_kb("VmHWM")
        status, answer = post(server, (tmp_path / "sparse.tif").read_bytes())
        assert status == 400 and "more than 5 m below the ground" in answer["error"]
        assert server.rss_kb("VmHWM") - before < 250_000


def test_a_survey_is_no_progress(site, tmp_path):
    tif(tmp_path / "design.tif", surface(-2, 0))
    with served(site, "--design", tmp_path / "design.tif") as server:
        corners = [[105, 205], [135, 205], [135, 235], [105, 235]]
        change = {"add": {"kind": "boundary", "name": "pit", "points": corners}}
        status, _ = server.post("/measures", [change])
        assert status == 200

        def strips(begin, first):
            """Ten minutes of work."""
            for k in range(10):
                for i, state in enumerate(passes("digger", 0, 0.8, 13)):
                    x, _, _ = state["position"]
                    yield {**state, "time": begin + 60 * k + 4.5 * i,
                           "position": [110 + 3 * x, 210 + 2 * (first + k), 9 if i < 12 else 13]}

        assert not [answer for answer in server.feed(strips(100, 0)) if "error" in answer]
        first = told(server)
        assert first["rate_m3_per_h"] > 0
        left = first["to_cut_m3"] + first["to_fill_m3"]
        # Ground that lies a metre lower is less to cut, but no machine did it.
        take(server, tif(tmp_path / "m.tif", surface(-1.5, 0)), "?heights=trusted")
        then = told(server)
        assert then["to_cut_m3"] + then["to_fill_m3"] < left - 500
        assert then["rate_m3_per_h"] is None and "since the last survey" in then["note"]
        server.kill()
    with served(site, "--design", tmp_path / "design.tif") as server:
        assert told(server) == then


def has_parts(server):
    return server.json("/summary.json")["volume_m3"].get("surveyed_added", 0) > 0


def rough(folder):
    """Of some hundred parts."""
    heights = np.zeros((121, 121), np.float32)
    heights[2:-2, 2:-2] = 0.3 * np.random.default_rng(1).random((117, 117))
    return tif(folder / "m.tif", heights, crs=None, first=(-30, -30))


def test_all_parts_that_are_taken_are_counted_on_a_full_disk(tmp_path):
    """So is the last, which is not on it yet."""
    data = rough(tmp_path)
    with small_disk(tmp_path / "disk", 3000) as disk:
        with Server(scenario(tmp_path, "output: {journal: {sync: always}}\n"), "--out", disk / "out",
                    cwd=tmp_path) as server:
            assert all("error" not in answer for answer in server.feed(passes("digger", 0.0, 0.3, 20)))
            fill(disk)
            status, answer = post(server, data)
            assert status == 500 and "No space left on device" in answer["error"], answer
            said = re.search(r"; (\d+) of (\d+) parts of it are taken, the same survey", answer["error"])
            (disk / "other").unlink()
            until(lambda: server.json("/summary.json")["acknowledged"]["updates"] == 20 + int(said[1]))
            taken = server.json("/summary.json")["volume_m3"]["surveyed_added"]
            assert int(said[1]) > 0 and taken > 0
            until(lambda: post(server, data)[0] == 200)
            assert server.json("/summary.json")["acknowledged"]["updates"] == 20 + int(said[1]) + int(said[2])


def test_a_kill_amid_a_survey_leaves_parts_of_it_and_the_rest_follows(tmp_path):
    data = rough(tmp_path)
    path = scenario(tmp_path, "output: {journal: {sync: always}}\n")
    states = list(passes("digger", 0.0, 0.3, 20))
    wanted = None
    for attempt in range(6):
        out = tmp_path / f"out{attempt}"
        with Server(path, "--out", out, cwd=tmp_path) as server:
            assert all("error" not in answer for answer in server.feed(states))
            if wanted is None:
                take(server, data)
                wanted, parts = digest(server), server.json("/summary.json")["acknowledged"]["updates"] - 20
                assert parts > 50
                continue
            worker = threading.Thread(target=send, args=(server, data))
            worker.start()
            until(lambda: has_parts(server))
            server.kill()
            worker.join()
        with Server(path, "--out", out, cwd=tmp_path) as server:
            done = server.json("/summary.json")["acknowledged"]["updates"] - 20
            assert digest(server) != wanted or done == parts
            take(server, data)
            assert digest(server) == wanted
        if 0 < done < parts:
            return
    raise AssertionError("it was never killed amid the survey")


def begin_post(server, data, length=None, path="/survey"):
    """A connection that has sent a post's head and these bytes of it."""
    address = urlsplit(server.url)
    link = socket.create_connection((address.hostname, address.port), 60)
    link.sendall(f"POST {path} HTTP/1.1\r\nHost: {address.netloc}\r\nContent-Length: {length or len(data)}\r\n\r\n"
                 .encode() + data)
    return link


def all_of(link):
    """Status and what is said, of a connection that is closed then."""
    answer = b""
    while more := link.recv(65536):
        answer += more
    head, body = answer.split(b"\r\n\r\n", 1)
    return int(head.split()[1]), json.loads(body)


def test_one_that_trickles_or_stops_gives_its_place_to_others(site, tmp_path):
    data = tif(tmp_path / "m.tif", surface())
    padded = data + bytes(4 << 20)
    ended = threading.Event()

    def trickle(link):
        for n in range(100, len(data)):
            if ended.wait(0.2):
                return
            link.sendall(data[n:n + 1])

    with Server(site, "--out", "a", cwd=tmp_path) as one, Server(site, "--out", "b", cwd=tmp_path) as other, \
            Server(site, "--out", "c", cwd=tmp_path, env={"TMPDIR": str(tmp_path)}) as halted:
        with begin_post(one, data[:100], len(data)) as trickles, begin_post(other, data[:100], len(data)) as stops, \
                begin_post(other, b"{", 100, "/feed") as feeds, begin_post(halted, padded[:-9], len(padded)) as goes_on:
            for server in (one, other):
                assert post(server, data)[0] == 503
            until(lambda: sum(path.stat().st_size for path in tmp_path.glob("soilvdb-survey-*/survey")) > len(data) + 4e6)
            halted.process.send_signal(signal.SIGSTOP)   # as a computer that sleeps
            sender = threading.Thread(target=trickle, args=(trickles,))
            sender.start()
            try:
                for link, words in ((trickles, "32 kB a second"), (stops, "32 kB a second"), (feeds, "within 20 s")):
                    status, answer = all_of(link)
                    assert status == 408 and words in answer["error"], answer
                goes_on.sendall(padded[-9:-3])
                halted.process.send_signal(signal.SIGCONT)
                assert halted.get("/height?x=120&y=220")[0] == 200
                goes_on.sendall(padded[-3:])
                assert b" 200 " in goes_on.recv(65536).split(b"\r\n")[0], "what came meanwhile came in time"
            finally:
                ended.set()
                sender.join()
            for server in (one, other):
                take(server, data)


def left(folder):
    return list(folder.glob("soilvdb-survey-*"))


def test_a_kill_leaves_no_file_of_it_once_a_server_starts_again(site, tmp_path):
    data = tif(tmp_path / "m.tif", surface())
    temp = tmp_path / "temp"
    temp.mkdir()
    (temp / "soilvdb-survey-notes").write_text("of somebody else")
    env = {"TMPDIR": str(temp)}
    first, second = (Server(site, "--out", tmp_path / name, cwd=tmp_path, env=env) for name in ("a", "b"))
    with first, second:
        with begin_post(first, data[:100], len(data)), begin_post(second, data[:100], len(data)) as other:
            until(lambda: len(left(temp)) == 3)
            first.kill()
            with Server(site, "--out", tmp_path / "a", cwd=tmp_path, env=env):
                assert len(left(temp)) == 2  # that of the second server is in use
            other.sendall(data[100:])
            assert b" 200 " in other.recv(65536)
        second.stop()
    assert [path.name for path in left(temp)] == ["soilvdb-survey-notes"]


def test_the_end_of_the_site_is_an_answer(tmp_path):
    data = rough(tmp_path)
    with Server(scenario(tmp_path), cwd=tmp_path) as server, begin_post(server, data) as link:
        until(lambda: has_parts(server))
        server.stop()
        status, answer = all_of(link)
        assert status == 503
        assert re.match(r"the site has ended; \d+ of \d+ parts of it are taken", answer["error"]), answer


def test_only_feeders_send_surveys_and_large_ones_are_refused(site, tmp_path):
    data = tif(tmp_path / "m.tif", surface())
    with served(site, "--token", "feeds", "--view-token", "looks") as server:
        assert post(server, data)[0] == 401
        assert post(server, data, headers={"Authorization": "Bearer looks"})[0] == 403
        assert post(server, data, headers={"Authorization": "Bearer feeds"})[0] == 200
    with served(site) as server:
        hashed = digest(server)
        address = urlsplit(server.url)
        with socket.create_connection((address.hostname, address.port), 30) as link:
            link.sendall(f"POST /survey HTTP/1.1\r\nHost: {address.netloc}\r\nContent-Length: {1 << 33}\r\n\r\n".encode())
            assert b" 413 " in link.recv(65536).split(b"\r\n")[0]
        # One whose sender goes away is forgotten, and the next is taken.
        with socket.create_connection((address.hostname, address.port), 30) as link:
            link.sendall(f"POST /survey HTTP/1.1\r\nHost: {address.netloc}\r\nContent-Length: {len(data)}\r\n"
                         "Expect: 100-continue\r\n\r\n".encode())
            assert b" 100 " in link.recv(65536)
            link.sendall(data[:1000])
            status, answer = post(server, data)
            assert status == 503 and "another survey" in answer["error"]
        assert digest(server) == hashed
        statuses = []
        until(lambda: statuses.append(post(server, data)[0]) or statuses[-1] != 503)
        assert statuses[-1] == 200
        status, body = server.get("/survey")
        assert status == 405
