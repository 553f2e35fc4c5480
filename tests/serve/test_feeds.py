# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What a feed takes, and what it refuses as no machine does it."""
import asyncio
import json
import shlex
import socket
import threading
import time
from datetime import datetime, timedelta, timezone
from pathlib import Path
from urllib.parse import urlsplit

from live import Server, passes, scenario, view, whole

DATA = Path(__file__).parents[2] / "data"

# Where the machine of the demonstrations begins, rad.
START = {"swing_joint": 0.0, "boom_joint": 0.41, "arm_joint": -0.92, "bucket_joint": -0.54}


def excavator(folder):
    """The machine of the demonstrations, to be fed."""
    text = (DATA / "excavator.yaml").read_text().replace("    motion: excavator.csv\n", "")
    for name in ("hills.tif", "excavator.urdf"):
        text = text.replace(name, str(DATA / name))
    path = folder / "excavator.yaml"
    path.write_text(text)
    return path


def joints(time_s, **changed):
    state = {"machine": "excavator", "joints": {**START, **changed}}
    return state if time_s is None else {**state, "time": time_s}


def test_force_is_told_to_who_asks(tmp_path):
    path = scenario(tmp_path, "soil: {repose_angle: 0.6, density: 1800, cohesion: 3000}\n")
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        *_, last = server.feed([{**state, "force": True} for state in passes("digger", 0, 0.2, 40)])
        assert last["force_n"][0] < -500 and abs(last["force_n"][1]) < 1, last
        assert len(last["moment_nm"]) == 3
        assert last["limited"] == "blade below ground", "its first face ends 0.1 m above the lip"
        none, = server.feed([{**next(passes("plate", 3, -0.5, 40)), "force": False}])
        assert "error" not in none and "force_n" not in none and "limited" not in none
        in_air, = server.feed([{**next(passes("plate", 3, -0.5, 40)), "force": True}])
        assert in_air["limited"] == ""
        bad, = server.feed([{**next(passes("plate", 3, -0.5, 40)), "force": 1}])
        assert bad["error"] == "'force' must be true or false"
    with Server(scenario(tmp_path), cwd=tmp_path) as server:
        refused, = server.feed([{**next(passes("digger", 0, 0.2, 40)), "force": True}])
        assert "needs the scenario's 'soil'" in refused["error"]
        assert server.json("/summary.json")["updates"] == 0


def test_times_may_be_dates_or_gps_times(tmp_path):
    """The same ground, ledger and recorded times as by numbers."""
    begin = 1777618800.0  # 2026-05-01T07:00:00Z

    def date(time_s):
        zone = timezone(timedelta(hours=2))
        return datetime.fromtimestamp(time_s, zone).isoformat(timespec="microseconds")

    def gps(time_s):
        return {"gps": divmod(time_s - 315964800 + 18, 604800)}

    summaries = []
    for number, write in enumerate((float, date, gps)):
        with Server(scenario(tmp_path), "--out", tmp_path / f"out{number}", cwd=tmp_path) as server:
            states = [{**state, "time": write(begin + k / 64)}
                      for k, state in enumerate(passes("digger", 0, 0.2, 40))]
            answers = server.feed(states)
            assert not any("error" in answer for answer in answers), answers
            machine, = [m for m in server.json("/machines")["machines"] if m["name"] == "digger"]
            assert machine["state"]["time"] == begin + 39 / 64
            for words in ("2026-05-01T07:00:00.25Z", "2026-05-01T09:00:00.25%2B02:00"):
                here = f"/height?x=1&y=0&time={begin + 0.25}", f"/height?x=1&y=0&time={words}"
                assert server.json(here[0]) == server.json(here[1])
            summaries.append(server.json("/summary.json"))
            for wrong, why in (
                    ("2026-05-01T07:00:01", "'time': '2026-05-01T07:00:01' has no offset from UTC"),
                    ("2026-05-01", "'time': '2026-05-01' is no date and time of day"),
                    ("noon", "'time' must be a number, a date such as \"2026-05-01T07:00:00.25+02"),
                    ("12.5", "'time' must be a number, a date such as"),
                    ({"gps": [368, 18]}, "'time': the GPS week is 368; it must be a whole number"),
                    ({"gps": [2416]}, "'time': 'gps' must be an array of 2 numbers"),
                    ({"gps": 1}, "'time': 'gps' must be an array of 2 numbers"),
                    ({"utc": 1}, "'time': unknown key 'utc'")):
                refused, = server.feed([{**states[-1], "time": wrong}])
                assert refused["error"].startswith(why), refused
            status, body = server.get("/height?x=1&y=0&time=2026-05-01T07:00:00")
            assert status == 400 and b"'time': '2026-05-01T07:00:00' has no offset" in body
    kept = [{key: summary[key] for key in ("state_hash", "volume_m3", "updates")}
            for summary in summaries]
    assert kept[0] == kept[1] == kept[2] and kept[0]["updates"] == 40


def test_joints_and_jumps_of_no_machine_are_refused_and_change_nothing(tmp_path):
    bad = [(joints(0.1, arm_joint=-52), "machine 'excavator': joint arm_joint is at -52 rad; the "
            "urdf limits it to -2.75 to -0.55, and at most 0.1 beyond is accepted; are these "
            "degrees?"),
           (joints(0.1, arm_joint=0.3), "joint arm_joint is at 0.3 rad; the urdf limits it to"),
           (joints(None, boom_joint=1.24), "joint boom_joint is at 1.24 rad"),
           (joints(0.1, boom_joint=-0.79), "joint boom_joint turns 1.2 rad in 0.1 s since the "
            "state before; its velocity limit in the urdf is 0.6 rad/s"),
           (joints(0.1, swing_joint=2.2), "joint swing_joint turns 2.2 rad in 0.1 s"),
           (joints(0.1, swing_joint=6.3), "joint swing_joint wraps from 0 to 6.3 rad; it must go "
            "on past a whole turn, to 0.01"),
           (joints(0.1, swing_joint=1e6), "machine 'excavator': joint swing_joint turns 1e+06 rad "
            "since the state before; at most 100 rad in one state")]
    with Server(excavator(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        first, = server.feed([joints(0.0)])
        assert "error" not in first
        before = server.json("/summary.json")["state_hash"]
        for state, why in bad:
            answer, = server.feed([state])
            assert why in answer["error"], state
        assert server.json("/summary.json")["state_hash"] == before
        # Limits hold for a first state, too; rounding and what sensors add is taken.
        for state in (joints(0.1, boom_joint=0.57), joints(0.1, boom_joint=0.61),
                      joints(2.0, arm_joint=-0.46), joints(3600.0, boom_joint=-0.79)):
            answer, = server.feed([state])
            assert "error" not in answer, state


def test_the_motion_of_the_demonstrations_is_taken_state_by_state(tmp_path):
    rows = [line.split(",") for line in (DATA / "excavator.csv").read_text().split()]
    with Server(excavator(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        for answer in server.feed({"machine": "excavator", "time": float(row[0]),
                                   "joints": dict(zip(rows[0][1:], map(float, row[1:])))}
                                  for row in rows[1:301]):
            assert "error" not in answer


def test_poses_that_no_bucket_reaches_are_refused(tmp_path):
    good = list(passes("digger", 0.0, 0.25, 60))
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(good[:10])
        far = {**good[10], "position": [good[9]["position"][0] + 5, 0, -0.2]}
        turned = {**good[10], "rotation": [0, 0, 1, 0]}
        for state, why in ((far, "machine 'digger': the bucket moves 5 m in 0.01 s since the state "
                            "before; no machine does more than 50 m/s"),
                           (turned, "machine 'digger': the bucket turns 3.14 rad in 0.01 s")):
            answer, = server.feed([state])
            assert why in answer["error"]
        # A second later they may be.
        for i, state in enumerate((far, {**far, "rotation": [0, 0, 1, 0]})):
            answer, = server.feed([{**state, "time": 1.0 + i}])
            assert "error" not in answer


def test_rotations_may_be_rounded(tmp_path):
    states = list(passes("digger", 0.0, 0.25, 30))
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        wanted = server.feed(states)
    rounded = [{**state, "rotation": [0, 0, 0, 1.0009 if i % 2 else 0.9991]}
               for i, state in enumerate(states)]
    with Server(scenario(tmp_path), "--out", tmp_path / "rounded", cwd=tmp_path) as server:
        for answer, other in zip(server.feed(rounded), wanted):
            assert (answer["cut_m3"], answer["bucket_m3"]) == (other["cut_m3"], other["bucket_m3"])
        answer, = server.feed([{**states[-1], "time": 9, "rotation": [0, 0, 0, 1.002]}])
        assert "its length is 1.002" in answer["error"]


def test_a_time_far_ahead_locks_no_machine_out(tmp_path):
    states = list(passes("digger", 0.0, 0.25, 60))

    def at(time_s, machine="digger"):
        return {**states[20], "time": time_s, "machine": machine}
    path = scenario(tmp_path)
    ahead = "machine 'digger': 'time' is 1000000.2 s, more than an hour ahead of the site's latest"
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        # A slip, twice: what comes after is taken. Another machine's slip doesn't agree with it.
        answers = server.feed([*states[:21], at(1e6 + 0.2), at(0.3), at(1e6 + 0.2), at(0.4)])
        assert ahead in answers[21]["error"] and ahead in answers[23]["error"]
        assert not [a for i, a in enumerate(answers) if i not in (21, 23) and "error" in a]
        # Nor does a slip to another hour.
        apart = server.feed([at(1e6 + 0.2), at(1e6 + 4000.0), at(0.45)])
        assert ["error" in a for a in apart] == [True, True, False]
        both = server.feed([at(1e6 + 0.2), at(1e6 + 0.3, "plate")])
        assert all("more than an hour ahead" in a["error"] for a in both)
        answers = server.feed([at(0.5), at(3600.4), at(7200.4)])
        assert not [a for a in answers if "error" in a], "an hour is no slip"
        server.stop()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        # A site that stood overnight goes on: its second state, or the first again, agrees.
        answers = server.feed([at(60_000), at(60_000), at(60_000.1), at(80_000, "plate")])
        assert ["error" in a for a in answers] == [True, False, False, True]
        answers = server.feed([at(80_001, "plate"), at(80_001.5)])
        assert not [a for a in answers if "error" in a]


def test_a_hundred_clients_half_of_them_stalled_hold_up_no_update(tmp_path):
    with Server(scenario(tmp_path, "soil: {repose_angle: 0.6}\n"), cwd=tmp_path) as server:
        def median_ms(begin):
            async def work():
                times = []
                async with server.connect("/feed") as feed:
                    for state in passes("digger", 0.0, 0.25, 300, begin):
                        sent = time.perf_counter()
                        await feed.send(json.dumps(state))
                        assert "error" not in json.loads(await feed.recv())
                        times.append(1e3 * (time.perf_counter() - sent))
                return sorted(times)[len(times) // 2]
            return asyncio.run(work())

        def stalled(request):
            client = socket.socket()
            client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            client.connect((address.hostname, address.port))
            client.sendall(request)
            return client

        def watch():
            async def work():
                async with server.connect("/view") as viewer:
                    while not done.is_set():
                        await viewer.recv()  # there is a state a second at least
            asyncio.run(work())

        address, done = urlsplit(server.url), threading.Event()
        alone = median_ms(0.0)
        view = (f"GET /view HTTP/1.1\r\nHost: {address.netloc}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
                "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n")
        large = f"GET /soil.vdb HTTP/1.1\r\nHost: {address.netloc}\r\n\r\n"
        clients = [stalled((view if i < 30 else large if i < 40 else view[:60]).encode()) for i in range(50)]
        viewers = [threading.Thread(target=watch) for _ in range(50)]
        for thread in viewers:
            thread.start()
        before = server.rss_kb()
        beside = [median_ms(10.0 * (i + 1)) for i in range(3)]
        done.set()
        for thread in viewers:
            thread.join()
        assert server.rss_kb() < before + 100_000
        for client in clients:
            client.close()
        # Threads of this test take a core from the server; what waits for the stalled ones takes seconds.
        assert min(beside) < 10 * alone + 5
        assert server.json("/summary.json")["updates"] == 1200


def run_curl(server, error):
    """Does what the command in a message says."""
    *options, url = shlex.split(error[error.index("curl "):])
    assert options[:3] == ["curl", "-X", "POST"] and url.startswith(server.url)
    headers = dict(line.replace("TOKEN", "s3cret").split(": ") for line in options[4:])
    return server.get("/" + url[len(server.url):], headers, "POST")


def test_a_machine_whose_clock_was_ahead_goes_on_and_other_times_stay_right(tmp_path):
    path = scenario(tmp_path, "soil: {repose_angle: 0.6, swell: 0.2}\n"
                    "output: {snapshots: {every: 0.1}, journal: {sync: always}}\n")
    begin = 1_700_000_000.0
    digs = list(passes("digger", 0.0, 0.25, 90, begin))
    pushes = list(passes("plate", 4.0, 0.15, 60, begin + 0.3))
    ahead = [{**state, "time": state["time"] + 1800} for state in digs[30:60]]
    known = {}

    def note(server, time_s):
        known[time_s] = server.json("/summary.json")["state_hash"]
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = server.feed([*digs[:30]])
        note(server, digs[29]["time"])
        answers += server.feed(state for both in zip(ahead, pushes) for state in both)
        note(server, pushes[29]["time"])
        assert not [a for a in answers if "error" in a]
        # Put right, it is refused, and told the way on.
        for state in digs[60:62]:
            answer, = server.feed([state])
            assert "machine 'digger': time goes back from 1700001800.59 s to 17000000" in answer["error"]
        assert server.json("/summary.json")["state_hash"] == known[pushes[29]["time"]]
        status, body = run_curl(server, answer["error"])
        assert (status, json.loads(body)) == (200, {"machine": "digger", "clock": "reset"})
        answers = server.feed(state for both in zip(digs[60:], pushes[30:]) for state in both)
        assert not [a for a in answers if "error" in a]
        note(server, digs[-1]["time"])
        answer, = server.feed([digs[60]])
        assert "time goes back from 1700000000.89 s" in answer["error"], "once"
        for time_s, hash_ in known.items():
            assert server.json(f"/summary.json?time={time_s}")["state_hash"] == hash_
        assert server.get("/height?x=0&y=0&time=1700001800")[0] == 400
        live, _ = asyncio.run(view(server, whole()))
        server.stop()
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        past, _ = asyncio.run(view(server, whole()))
        for time_s, hash_ in known.items():
            assert server.json(f"/summary.json?time={time_s}")["state_hash"] == hash_
            texts, _ = asyncio.run(view(server, lambda texts, _: texts and texts[-1]["type"] == "view",
                                        [{"time": time_s}]))
            assert texts[-1]["state"]["time_s"] == time_s
        assert server.get("/clock?machine=digger", method="POST")[0] == 403
    for texts in (live, past):
        times = texts[0]["times"]
        assert (times["from"], times["to"]) == (begin, digs[-1]["time"])
        assert all(begin <= time_s <= times["to"] for time_s in times["snapshots"])
    # Opened again it is the same, and goes on.
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert server.json("/summary.json")["state_hash"] == known[digs[-1]["time"]]
        texts, _ = asyncio.run(view(server, whole()))
        assert texts[0]["times"]["to"] == digs[-1]["time"]
        answers = server.feed([{**digs[60], "time": begin + 2}, digs[61]])
        assert ["error" in a for a in answers] == [False, True]


def test_a_clock_set_without_a_state_since_survives_a_crash(tmp_path):
    path = scenario(tmp_path, "output: {journal: {sync: always}}\n")
    states = list(passes("digger", 0.0, 0.25, 60))
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        late, answer, unknown, other = server.feed([
            {**states[0], "time": 1000}, {"machine": "digger", "clock": "reset"},
            {"machine": "diger", "clock": "reset"}, {"machine": "digger", "clock": "set"}])
        assert "error" not in late and answer == {"machine": "digger", "clock": "reset"}
        assert "there is no machine 'diger'" in unknown["error"]
        assert "'clock' must be \"reset\"" in other["error"]
        server.kill()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        answers = server.feed(states)
        assert not [a for a in answers if "error" in a]
        texts, _ = asyncio.run(view(server, whole()))
        assert (texts[0]["times"]["from"], texts[0]["times"]["to"]) == (0, states[-1]["time"])


def test_a_first_time_beyond_the_clock_of_the_computer_is_refused(tmp_path):
    state = next(passes("digger", 0.0, 0.25, 60))
    path = scenario(tmp_path)
    path.write_text(path.read_text().replace("name: plate", 'name: "Bagger 2 & ü"'))
    for name in ("digger", "Bagger 2 & ü"):
        with Server(path, "--out", tmp_path / name[:3], "--token", "s3cret", cwd=tmp_path) as server:
            def feed(time_s, name=name):
                return server.feed([{**state, "machine": name, "time": time_s}], "/feed?token=s3cret")[0]
            for more in (0.0, 0.0, 0.1):  # however often
                error = feed(time.time() + 2 * 3600 + more)["error"]
                assert "2.0 hours ahead of this computer's clock; set the clock that is wrong" in error
            assert server.get("/clock?machine=digger", method="POST")[0] == 401
            assert server.get("/clock?machine=nobody&token=s3cret", method="POST")[0] == 400
            assert server.get("/clock?machine=digger&token=s3cret")[0] == 404
            assert server.get("/height?x=0&y=0&token=s3cret", method="POST")[0] == 405
            # The computer's may be the one that is wrong.
            assert run_curl(server, error)[0] == 200
            assert "error" not in feed(time.time() + 2 * 3600)
            assert "error" not in feed(time.time() + 2 * 3600 + 1), "it agrees with the site's"
    with Server(path, "--out", tmp_path / "c", cwd=tmp_path) as server:
        answers = server.feed([{**state, "time": time.time() + 1800}, {**state, "time": time.time() + 1801}])
        assert not [a for a in answers if "error" in a]
    for time_s in (9e8, 0.0):  # counted from whenever
        with Server(path, "--out", tmp_path / str(time_s), cwd=tmp_path) as server:
            assert "error" not in server.feed([{**state, "time": time_s}])[0]
