# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A site whose disk fills: it says so, takes nothing that it can't keep, and goes on by itself."""
import contextlib
import os
import subprocess
import time

import pytest
from live import Server, passes, scenario

SAMPLE_M3 = 0.05 ** 3 / 64
SOIL = "soil: {repose_angle: 0.6, swell: 0.2}\n"


@contextlib.contextmanager
def small_disk(folder, kilobytes):
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", folder],
                          capture_output=True, text=True)
    if done.returncode != 0:
        pytest.skip("no small disk can be mounted: " + done.stderr.strip())
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def fill(disk):
    with open(disk / "other", "wb", buffering=0) as file, contextlib.suppress(OSError):
        while True:
            file.write(b"x" * 4096)


@pytest.mark.parametrize("sync", ["1", "always"])
def test_a_full_disk_refuses_states_until_there_is_room(tmp_path, sync):
    path = scenario(tmp_path, SOIL + f"output: {{snapshots: {{every: 0.5}}, journal: {{sync: {sync}}}}}\n")
    states = [state for k in range(8) for state in passes("digger", 1.5 * k, 0.25, 60, begin=10.0 * k)]
    taken = []

    def feed(server, states):
        answers = server.feed(states)
        for state, answer in zip(states, answers):
            if "error" not in answer:
                taken.append(state)
        return answers
    with small_disk(tmp_path / "disk", 3000) as disk:
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            assert not [a for a in feed(server, states[:60]) if "error" in a]
            for round_ in range(2):
                fill(disk)
                todo, errors, until = states[60 + 120 * round_:180 + 120 * round_], [], time.monotonic() + 20
                while not errors:
                    assert time.monotonic() < until
                    answers = feed(server, todo[:10])
                    errors = [a["error"] for a in answers if "error" in a]
                    todo = todo[10:]
                    if not errors:
                        time.sleep(0.3)
                assert "No space left on device; states are refused until there is room" in errors[0]
                ground = server.json("/summary.json")["state_hash"]
                answers = feed(server, todo[:3])
                assert all("No space left" in answer["error"] for answer in answers)
                assert server.json("/summary.json")["state_hash"] == ground, "what is refused digs nothing"
                assert server.get("/height?x=1&y=0")[0] == 200, "looking goes on"
                os.remove(disk / "other")
                until = time.monotonic() + 5
                while "error" in feed(server, todo[:1])[0]:
                    assert time.monotonic() < until, "it goes on by itself"
                    time.sleep(0.2)
                assert not [a for a in feed(server, todo[1:]) if "error" in a]
            dug = server.json("/summary.json")["state_hash"]
            server.stop()
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            assert server.json("/summary.json")["state_hash"] == dug
    if sync == "always":
        return  # what was dug before its record failed is kept, too
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        server.feed(taken)
        assert server.json("/summary.json")["state_hash"] == dug


def test_the_state_that_filled_the_disk_is_counted_once(tmp_path):
    """It is dug and refused, because it isn't on disk. Sent again, it has the answer that it should have had."""
    path = scenario(tmp_path, SOIL + "output: {journal: {sync: always}}\n")
    states = [{**state, "sequence": i} for i, state in enumerate(
        state for k in range(9) for state in passes("digger", 1.5 * k, 0.25, 60, begin=10.0 * k))]
    with small_disk(tmp_path / "disk", 3000) as disk:
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            answers = server.feed(states[:1])
            fill(disk)
            at, told = next((i, answer) for i, answer in enumerate(server.feed(states), 0) if "error" in answer)
            assert "it is taken, but not on disk yet: " in told["error"] and at < len(states) - 60, told
            again, after = server.feed(states[at:at + 2])
            assert "No space left" in again["error"] and "No space left" in after["error"]
            assert "taken" not in again["error"] + after["error"], "dug once"
            os.remove(disk / "other")
            until = time.monotonic() + 20
            while "error" in (again := server.feed([states[at]])[0]):
                assert time.monotonic() < until, again
            assert again["repeated"] and again["sequence"] == at
            # Of those before it, and all after it, the first answers.
            answers = [answer for answer in server.feed(states[max(0, at - 1000):])]
            assert not [answer for answer in answers if "error" in answer]
            cut_m3 = sum(round(answer["cut_m3"] / SAMPLE_M3) for answer in answers) * SAMPLE_M3
            report = server.get("/report.csv")
            assert cut_m3 == server.json("/summary.json")["volume_m3"]["cut"] > 0
            assert float(report[1].decode().splitlines()[-1].split(",")[6]) == cut_m3
            server.kill()
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            assert server.get("/report.csv") == report


def test_what_was_not_on_disk_when_it_filled_is_kept(tmp_path):
    path = scenario(tmp_path, SOIL + "output: {journal: {sync: 0.1}}\n")
    with small_disk(tmp_path / "disk", 1000) as disk:
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            states = list(passes("digger", 0.0, 0.25, 2000))
            fill(disk)
            count = next((i for i, answer in enumerate(server.feed(states)) if "error" in answer), None)
            assert count, "it filled"
            os.remove(disk / "other")
            until = time.monotonic() + 5
            while server.json("/summary.json")["acknowledged"]["updates"] < count:
                assert time.monotonic() < until
                time.sleep(0.1)
            ground = server.json("/summary.json")["state_hash"]
            server.kill()
        with Server(path, "--out", disk / "out", cwd=tmp_path) as server:
            assert server.json("/summary.json")["updates"] >= count
            assert server.json("/summary.json")["state_hash"] == ground
