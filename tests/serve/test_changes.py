# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Machines and hoppers that come to a site and leave it."""
import subprocess

from live import PROGRAM, Server, passes, scenario

SOIL = ("soil: {repose_angle: 0.6, swell: 0.2}\noutput: {snapshots: {every: 0.3}, journal: {sync: always}}\n")
THIRD = "  - {name: third, bucket: {width: 0.5, height: 0.5}}\n"
SCRAPER = "  - {name: scraper, bucket: {width: 2.0, height: 0.5}}\n"


def changed(path, before, after):
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))


def start_fails(path, out):
    done = subprocess.run([PROGRAM, "serve", path, "--out", out, "--port", "0"], capture_output=True,
                          text=True, timeout=60)
    assert done.returncode == 2, done
    return done.stderr


def hash_of(server, query=""):
    return server.json("/summary.json" + query)["state_hash"]


def test_machines_come_and_go_and_those_that_stay_go_on(tmp_path):
    path = scenario(tmp_path, SOIL)
    out, states = tmp_path / "out", list(passes("plate", 0.0, 0.2, 60))
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert not [a for a in server.feed([*states[:40]]) if "error" in a]
        dug, machines = hash_of(server), server.json("/machines")["machines"]
        server.stop()
    # A scraper comes in place of one that never came, and a third machine.
    text = path.read_text()
    begin, end = text.index("  - name: digger"), text.index("  - name: plate")
    path.write_text(text[:begin] + SCRAPER + text[end:].replace("soil:", THIRD + "soil:"))
    for part in range(2):   # the second start finds the changed recording
        with Server(path, "--out", out, cwd=tmp_path) as server:
            assert hash_of(server) == dug
            now = {machine["name"]: machine for machine in server.json("/machines")["machines"]}
            assert list(now) == ["scraper", "plate", "third"] and now["scraper"]["state"] is None
            assert now["plate"]["state"] == machines[1]["state"]
            assert now["plate"]["bucket_m3"] == machines[1]["bucket_m3"]
            assert server.json("/summary.json")["mass_kg"]["residual"] == 0
            server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        early = hash_of(server, "?time=0.2")
        both = [state for three in zip(states[40:], passes("scraper", 4.0, 0.2, 20, begin=0.4),
                                       passes("third", 8.0, 0.2, 20, begin=0.4)) for state in three]
        assert not [a for a in server.feed(both) if "error" in a]
        dug = hash_of(server)
        server.kill()
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert hash_of(server) == dug and hash_of(server, "?time=0.2") == early
    with Server(out, cwd=tmp_path) as server:
        assert hash_of(server) == dug
    done = subprocess.run([PROGRAM, "verify", out], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done
    # The same fed at once, of a site that had all of them from the beginning.
    with Server(path, "--out", tmp_path / "alone", cwd=tmp_path) as server:
        server.feed([*states[:40], *both])
        assert hash_of(server) == dug


def test_what_a_recording_needs_is_not_taken_away(tmp_path):
    path = scenario(tmp_path, SOIL)
    out = tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        server.feed(passes("digger", 0.0, 0.2, 30))
        dug = hash_of(server)
        server.stop()
    good, journal = path.read_text(), (out / "journal").read_bytes()
    begin, end = good.index("  - name: digger"), good.index("  - name: plate")
    for text, why in ((good[:begin] + good[end:], "has states of machine 'digger', which the site no longer has"),
                      (good[:begin] + SCRAPER + good[begin:], "'digger' as number 1 in the list of machines; keep its place"),
                      (good.replace("name: digger", "name: bagger"), "has states of machine 'digger'"),
                      (good.replace("width: 1.2", "width: 1.3"), "another site: machine 1: bucket differs"),
                      (good + SCRAPER.replace("  - ", "hoppers:\n  - ").replace(
                          "bucket: {width: 2.0, height: 0.5}", "box: [0, 0, 1, 1], top: 1.0"), "hoppers differs")):
        path.write_text(text)
        assert why in start_fails(path, out), text
        assert (out / "journal").read_bytes() == journal
        assert not list(out.glob(".*")), "no copy is left"
    path.write_text(good)
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert hash_of(server) == dug


def test_hoppers_come_and_go_from_the_end_of_a_recording_on(tmp_path):
    hoppers = "hoppers:\n  - {{name: {}, box: [{}, -2, {}, 2], top: 0.5, time: [{}, {}]}}\n"
    first = hoppers.format("first", 5, 7, 0, 600)
    path = scenario(tmp_path, SOIL + first)
    out = tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        server.feed(passes("digger", 0.0, 0.2, 30))
        dug = hash_of(server)
        server.stop()
    second = "  - {name: second, box: [8, -2, 10, 2], top: 0.5, time: [%s, 900]}\n"
    changed(path, first, first.replace("600", "0.3") + second % "0.3")
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert hash_of(server) == dug
        assert "error" not in server.feed([list(passes("digger", 0.0, 0.2, 60))[59]])[0]
        server.stop()
    changed(path, second % "0.3", second % "0.1")
    assert "hopper" in start_fails(path, out)
