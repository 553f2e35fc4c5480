# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Feeds by POST: the lines, answers, limits and owners of the WebSocket."""
import asyncio
import json
import random
import socket
import subprocess
import threading
from urllib.parse import urlsplit

import pytest
from live import Server, passes, scenario

SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\noutput: {journal: {sync: always}}\n"
STATES = list(passes("digger", 0.0, 0.3, 60))
# What is sent may be wrong.
BAD = ["", " \t", "{", "[]", "1", '{"machine": 1}', '{"machine": "none", "time": 1}', "\x00\xff", "{" * 200,
       '{"machine": "digger", "time": NaN}', '{"machine": "digger", "clock": "set"}']


def digest(server):
    return server.json("/summary.json")["state_hash"]


def machine(server, name):
    return next(m for m in server.json("/machines")["machines"] if m["name"] == name)


def without_time(answers):
    """The part of answers that does not depend on the disk's speed."""
    return [{key: value for key, value in answer.items() if key != "acknowledged_s"} for answer in answers]


def talk(server, data, end=True):
    """What the server sends on a bare connection."""
    address = urlsplit(server.url)
    with socket.create_connection((address.hostname, address.port), 30) as link:
        try:
            link.sendall(data)
            if end:
                link.shutdown(socket.SHUT_WR)
        except ConnectionError:
            pass  # it has answered
        return b"".join(iter(lambda: link.recv(65536), b""))


def head(server, more, target="/feed"):
    return f"POST {target} HTTP/1.1\r\nHost: {urlsplit(server.url).netloc}\r\n{more}\r\n\r\n".encode()


def test_posts_dig_as_a_stream_does_and_are_kept(tmp_path):
    path = scenario(tmp_path, SOIL)
    lines = [*STATES[:20], BAD[2], *passes("plate", 3.0, 0.2, 20), *STATES[20:],
             {"machine": "digger", "clock": "reset"}, {**STATES[0], "sequence": 5}]
    with Server(path, "--out", tmp_path / "stream", cwd=tmp_path) as server:
        wanted, dug = server.feed(lines), digest(server)
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        told, rng = [], random.Random(1)
        while len(told) < len(lines):  # in parts of any size
            status, answers = server.post("/feed", lines[len(told):len(told) + rng.randrange(1, 30)])
            assert status == (200 if any("error" not in a for a in answers) else 400)
            told += answers
        assert without_time(told) == without_time(wanted) and digest(server) == dug
        assert told[59]["acknowledged_s"] is not None, "with sync it is on disk"
        # An answer that was lost is asked for again.
        status, (again,) = server.post("/feed", [lines[-1]])
        assert status == 200 and again["repeated"] and digest(server) == dug
        server.kill()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert digest(server) == dug


def test_lines_that_are_wrong_get_an_error_each_and_dig_nothing(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        status, answers = server.post("/feed", [BAD[2], STATES[0], BAD[5], "", STATES[1]])
        assert status == 200 and ["error" in a for a in answers] == [True, False, True, False]
        before, rng = digest(server), random.Random(2)
        for _ in range(60):
            lines = [rng.choice(BAD) for _ in range(rng.randrange(4))]
            status, answers = server.post("/feed", "\n".join(lines).encode("latin1"))
            assert status == 400 and all("error" in a for a in answers) and answers
            assert len(answers) == max(1, sum(bool(line.strip(" \t")) for line in lines))
        assert server.post("/feed")[1] == [{"error": "an empty message; send a line of JSON"}]
        status, (told,) = server.post("/feed?machine=digger", [STATES[2]])
        assert status == 400 and "machine" in told["error"]
        status, (told,) = server.post("/fed", [STATES[2]])
        assert status == 405 and "only GET is answered, and POST of /feed" in told["error"]
        assert digest(server) == before


def test_a_body_has_the_limit_of_a_message(tmp_path):
    line = json.dumps({**STATES[0]}) + "\n"
    most = (line * 2000)[:65536]
    most = most[:most.rindex("\n")].ljust(65536)
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        status, answers = server.post("/feed", most)
        assert status == 200 and len(answers) == most.count("machine")
        fed = server.json("/summary.json")["updates"]
        for size in (65537, 10_000_000):
            # A client that sends all before it reads has its answer, too.
            said = talk(server, head(server, f"Content-Length: {size}") + (most + " " * size)[:size].encode())
            assert said.startswith(b"HTTP/1.1 413 ") and b"larger than 64 kB" in said, said[:200]
        chunk = f"{len(line):x}\r\n{line}\r\n".encode()
        said = talk(server, head(server, "Transfer-Encoding: chunked") + 3000 * chunk + b"0\r\n\r\n")
        assert said.startswith(b"HTTP/1.1 413 "), said[:200]
        assert server.json("/summary.json")["updates"] == fed, "nothing of it was taken"
        said = talk(server, head(server, "Transfer-Encoding: chunked") + 3 * chunk + b"0\r\n\r\n")
        assert said.startswith(b"HTTP/1.1 200 ") and said.count(b"cut_m3") == 3
        said = talk(server, head(server, "Content-Length: 900") + line.encode())  # torn
        assert b"cut_m3" not in said and server.json("/summary.json")["updates"] == fed + 3
        # A client may wait until it is asked for the body.
        address = urlsplit(server.url)
        with socket.create_connection((address.hostname, address.port), 30) as link:
            link.sendall(head(server, f"Content-Length: {len(line)}\r\nExpect: 100-continue"))
            assert link.recv(100).startswith(b"HTTP/1.1 100 ")
            link.sendall(line.encode())
            assert link.recv(1000).startswith(b"HTTP/1.1 200 ")
        said = talk(server, b"GET" + head(server, "Content-Length: 3", "/machines")[4:] + b"abc")
        assert said.startswith(b"HTTP/1.1 400 ") and b"only a POST may have a body" in said


def test_only_those_who_feed_may_post(tmp_path):
    (tmp_path / "feeds").write_text("d1g")
    (tmp_path / "looks").write_text("l00k")
    with Server(scenario(tmp_path), "--token-file", "feeds", "--view-token-file", "looks", "--out",
                tmp_path / "out", cwd=tmp_path) as server:
        for token, wanted in (("", 401), ("l00k", 403), ("d1g", 200)):
            for path, headers in ((f"/feed?token={token}", {}), ("/feed", {"Authorization": f"Bearer {token}"})):
                status, answers = server.post(path, [STATES[0]], headers)
                assert status == wanted and ("error" in answers[0]) == (wanted != 200)
            # Who may not feed need not send the body.
            said = talk(server, head(server, "Content-Length: 60000", f"/feed?token={token}"), end=wanted == 200)
            assert said.startswith(b"HTTP/1.1 %d " % wanted) or wanted == 200
        assert server.post("/feed?token=d1g", [STATES[1]], {"Origin": "http://elsewhere.example"})[0] == 403
        assert server.json("/summary.json?token=d1g")["updates"] == 2
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        status, (told,) = server.post("/feed", [STATES[0]])
        assert status == 403 and "can only be viewed" in told["error"]


def test_a_post_is_a_feed_that_ends_with_it(tmp_path):
    async def work(server):
        loop = asyncio.get_running_loop()

        async def post(states):
            return await loop.run_in_executor(None, server.post, "/feed", states)
        async with server.connect("/feed") as feed:
            await feed.send(json.dumps(STATES[0]))
            assert "error" not in json.loads(await feed.recv())
            status, (told, other) = await post([STATES[1], next(passes("plate", 3.0, 0.2, 20))])
            assert status == 200 and "machine 'digger' is fed by 127.0.0.1:" in told["error"]
            assert "error" not in other
            there = {m["name"]: m for m in server.json("/machines")["machines"]}
            assert there["plate"]["link"] == "none" and there["plate"]["owner"] is None
            assert there["digger"]["link"] == "live"
        while (await post([STATES[2]]))[0] != 200:  # until the site knows that the stream has ended
            await asyncio.sleep(0.05)
        async with server.connect("/feed") as feed:  # takes over, because the post has ended
            await feed.send(json.dumps(STATES[3]))
            assert "error" not in json.loads(await feed.recv())
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        asyncio.run(work(server))


def test_posts_at_once_are_fed_whole_or_refused(tmp_path):
    """Of a machine, all states of a post come before those of the next, or are refused."""
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = [None] * 8

        def post(i):
            y = 2.0 * (i % 4)
            states = [{**s, "time": None} for s in passes("digger" if i % 2 else "plate", y, 0.2, 200)]
            answers[i] = server.post("/feed", states)
        threads = [threading.Thread(target=post, args=[i]) for i in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        taken = sum("error" not in line for _, lines in answers for line in lines)
        for status, lines in answers:
            assert len(lines) == 200 and status == (200 if any("error" not in line for line in lines) else 400)
            assert all("error" not in line or "is fed by" in line["error"] for line in lines)
        assert taken == server.json("/summary.json")["updates"] >= 400
        assert server.json("/summary.json")["volume_m3"]["residual"] == pytest.approx(0, abs=1e-9)


def test_curl_as_in_the_guide(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        (tmp_path / "states.jsonl").write_text("\n".join(map(json.dumps, STATES)))
        done = subprocess.run(["curl", "-sf", "--data-binary", "@states.jsonl", server.url + "feed"], cwd=tmp_path,
                              capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done
        assert len(done.stdout.splitlines()) == 60 and "error" not in done.stdout
        assert machine(server, "digger")["time_s"] == STATES[-1]["time"]
