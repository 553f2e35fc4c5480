# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Queries that share a computer, and sections as fine as they need to be."""
import asyncio
import json
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from live import Server, passes, scenario

SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\n"


def dig(server, passes_):
    for k in range(passes_):
        answers = server.feed(passes("digger", 2.0 * k, 0.3, 60, begin=10.0 * k))
        assert not [a for a in answers if "error" in a]


def test_a_height_does_not_wait_for_32_large_sections_while_a_machine_digs(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        dig(server, 8)
        done = threading.Event()

        def feed():
            async def work():
                async with server.connect("/feed") as feed:
                    for state in passes("digger", 1.0, 0.25, 2000, begin=100.0):
                        await feed.send(json.dumps(state))
                        assert "error" not in json.loads(await feed.recv())
                        await asyncio.sleep(0.002)
                        if done.is_set():
                            return
            asyncio.run(work())

        def section(i):
            status, body = server.get(f"/section?from={0.1 * i},-2&to={4 - 0.1 * i},18&points=5000")
            assert status == 200 and len(json.loads(body)["now_m"]) == 5000

        def height():
            begin = time.perf_counter()
            assert server.get("/height?x=1&y=0")[0] == 200
            return 1e3 * (time.perf_counter() - begin)
        feeding = threading.Thread(target=feed)
        feeding.start()
        try:
            height()
            with ThreadPoolExecutor(32) as pool:
                sections = [pool.submit(section, i % 20) for i in range(200)]
                times = []
                while not all(section.done() for section in sections):
                    times.append(height())
                    time.sleep(0.01)
                for section in sections:
                    section.result()
        finally:
            done.set()
            feeding.join()
        times.sort()
        # The threads of this test share two cores with the server, so the worst is theirs.
        assert len(times) >= 5 and times[int(0.8 * len(times))] < 50, times


def test_heights_follow_the_ground_that_is_dug(tmp_path):
    places = np.random.default_rng(3).uniform([-1, -1], [5, 3], (40, 2))
    path = scenario(tmp_path, SOIL + "output: {journal: {sync: always}}\n")
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        for k in range(3):
            last = list(passes("digger", 0.4 * k, 0.2 + 0.1 * k, 60, begin=10.0 * k))
            server.feed(last)
            for x, y in places:
                now = server.json(f"/height?x={x}&y={y}")
                there = server.json(f"/height?x={x}&y={y}&time={last[-1]['time']}")
                assert now == there
            query = "from=-1,-0.5&to=5,1.5&points=300"
            assert (server.json(f"/section?{query}")
                    == server.json(f"/section?{query}&time={last[-1]['time']}"))


def test_too_many_queries_of_a_client_are_refused(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        dig(server, 3)
        host, port = server.url.split("//")[1].strip("/").split(":")

        async def ask(clients):
            """Statuses of a query of each, which all have come before the server reads the first."""
            connections = [await asyncio.open_connection(host, int(port)) for _ in clients]
            server.process.send_signal(signal.SIGSTOP)
            for i, (client, (_, writer)) in enumerate(zip(clients, connections)):
                # Each is another time, so each is dug again.
                writer.write(f"GET /summary.json?time={20 + 0.001 * i} HTTP/1.1\r\n"
                             f"Host: {host}:{port}\r\nX-Forwarded-For: {client}\r\n"
                             "Connection: close\r\n\r\n".encode())
                await writer.drain()
            server.process.send_signal(signal.SIGCONT)

            async def status(reader, writer):
                head = await reader.readline()
                await reader.read()
                writer.close()
                return int(head.split()[1])
            return await asyncio.gather(*[status(*each) for each in connections])
        statuses = asyncio.run(ask(["greedy"] * 200 + ["modest"] * 2))
        greedy, modest = statuses[:200], statuses[200:]
        live, _ = server.get("/section?from=0,0&to=4,4&points=50")
    assert live == 200 and modest == [200, 200]
    assert set(greedy) == {200, 429}


def test_a_long_section_has_the_cut_of_a_fine_one(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        # A trench of 1.2 m across lines that have a point each 2 m.
        server.feed(passes("digger", 0.0, 0.5, 60))
        fine = server.json("/section?from=2,-2&to=2,2&points=4000")
        assert fine["cut_m2"] == pytest.approx(1.2 * 0.5, rel=0.02) and fine["fill_m2"] < 1e-3

        def trapezoids(line):
            change = np.array(line["now_m"]) - np.array(line["before_m"])
            return -np.trapz(change, line["distance_m"])
        assert trapezoids(fine) == pytest.approx(fine["cut_m2"] - fine["fill_m2"], rel=1e-6)
        for begin in np.linspace(-500, -498, 7):
            line = server.json(f"/section?from=2,{begin}&to=2,{begin + 1000}&points=500")
            assert line["cut_m2"] == pytest.approx(fine["cut_m2"], rel=0.05), begin
            assert trapezoids(line) == pytest.approx(line["cut_m2"] - line["fill_m2"], rel=1e-9)
            assert len(line["now_m"]) == len(line["distance_m"]) == 500
        # Points no farther apart than a voxel are places.
        line = server.json("/section?from=2,-1&to=2,1&points=50")
        for i in range(0, 50, 7):
            y = -1 + line["distance_m"][i]
            assert server.json(f"/height?x=2&y={y!r}")["height_m"] == pytest.approx(line["now_m"][i], abs=1e-9)


def test_a_boundary_that_crosses_itself_is_refused(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        status, body = server.get("/volume?boundary=0,0,4,3,4,0,0,3")
        assert status == 400 and b"crosses itself" in body
