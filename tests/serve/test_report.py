# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Reports of the machines' work: their sums are the ledger's, whatever was fed and whenever."""
import csv
import json
import math
import random
import re
import subprocess
import time
from datetime import datetime, timezone
from html.parser import HTMLParser

import pytest

from live import PROGRAM, SCENARIO, Server, scenario, state_told

VOXEL_M, SWELL, DENSITY = 0.05, 0.2, 1700
SAMPLE_M3 = VOXEL_M ** 3 / 64
UNITS_PER_SAMPLE = 65536   # of loose mass, core/include/soilvdb/mass.h
BANK_UNITS = round((1 + SWELL) * UNITS_PER_SAMPLE)
SOIL = f"soil: {{repose_angle: 0.6, swell: {SWELL}, density: {DENSITY}}}\n"
HOPPERS = "hoppers:\n  - {name: truck, box: [4.5, -2, 8, 12], top: 0.5}\n"
TALL = "  - name: late\n    bucket: {width: 0.8, height: 0.6}\n"


def turned(pitch):
    return [0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)]


def cycle(machine, y, begin_s, step_s=1.0, tips=True, to_m=4.0):
    """States of a cut along x, a lift, and a turn over the place where x is `to_m`."""
    at = [(0.4 * i, -0.02 * i, -0.3) for i in range(9)]
    at += [(3.2, -0.1 + 0.4 * i, -0.5) for i in range(5)]
    at += [(3.2 + (to_m - 3.2) * i / 4, 1.6, -0.6) for i in range(5)]
    if tips:
        at += [(to_m, 1.6, -0.6 + 0.3 * i) for i in range(9)]
        at += [(to_m, 1.6, 1.8 - 0.6 * i) for i in range(5)]
    for i, (x, z, pitch) in enumerate(at):
        yield {"machine": machine, "time": begin_s + step_s * i, "position": [x, y, z],
               "rotation": turned(pitch)}


def feed(server, states):
    answers = server.feed(states)
    assert not [answer for answer in answers if "error" in answer], answers


def report(server, query=""):
    status, body = server.get("/report.csv" + query)
    assert status == 200, body
    return list(csv.DictReader(body.decode().splitlines()))


def number(row, name):
    return float(row[name]) if row[name] else 0.0


def require_sums(server, soil=True):
    """The report's sums are the summary's, in whole samples and units of mass."""
    summary = server.json("/summary.json")
    volumes, machines = summary["volume_m3"], {m["name"]: m for m in summary["machines"]}
    for every in (60, 900, 3600, 86400):
        rows = report(server, f"?every={every}")
        totals = {row["machine"]: row for row in rows if row["span"] == "total"}
        periods = [row for row in rows if row["span"] == "period"]
        assert float(totals["all"]["cut_m3_bank"]) == volumes["cut"]
        for name, machine in machines.items():
            assert float(totals[name]["cut_m3_bank"]) == machine["cut_m3"], name
        if soil:
            assert float(totals["all"]["put_down_m3_loose"]) == volumes["spilled"] == state_told(server)["spilled_m3"]
            assert float(totals["all"]["hauled_m3_loose"]) == volumes["hauled"]
            kg = lambda units: units / BANK_UNITS * SAMPLE_M3 * DENSITY
            spilled = round(volumes["spilled"] / SAMPLE_M3 * UNITS_PER_SAMPLE)
            wanted_t = (kg(spilled) + summary["mass_kg"]["buckets"]) / 1000
            assert float(totals["all"]["load_t"]) == pytest.approx(wanted_t, rel=1e-12)
        units = {"cut_m3_bank": SAMPLE_M3, "put_down_m3_loose": SAMPLE_M3 / UNITS_PER_SAMPLE,
                 "hauled_m3_loose": SAMPLE_M3 / UNITS_PER_SAMPLE,
                 "load_t": SAMPLE_M3 * DENSITY / 1000 / BANK_UNITS, "cycles": 1}
        for column, unit in units.items():
            if not soil and column == "load_t":
                assert not totals["all"][column]
                continue
            count = {id(row): round(number(row, column) / unit) for row in rows}
            for row in rows:
                if row["machine"] == "all":   # of its machines
                    assert count[id(row)] == sum(
                        count[id(other)] for other in rows if other["machine"] != "all" and
                        other["span"] == row["span"] and other["from_s"] == row["from_s"])
            for name, total in totals.items():   # of its periods
                assert count[id(total)] == sum(
                    count[id(row)] for row in periods if row["machine"] == name), (name, column)
        for column in ("working_s", "idle_s"):
            assert number(totals["all"], column) == pytest.approx(
                sum(number(row, column) for row in periods if row["machine"] != "all"), abs=1e-3)
    return totals


@pytest.mark.parametrize("seed", range(4))
def test_sums_over_machines_and_periods_are_the_ledgers(tmp_path, seed):
    """Rigid and moving soil, kills, a machine that joins, resumed recordings, clocks set back."""
    rng = random.Random(seed)
    soil = (SOIL + HOPPERS) if seed % 2 == 0 else ""
    epoch = rng.choice([0.0, -5000.0, 1.7e9])
    path, now_s = scenario(tmp_path, soil), {"digger": epoch, "plate": epoch}
    synced = "output: {journal: {sync: always}, snapshots: {every: 300}}\n"
    for restart in range(3):
        machines = ["digger", "plate"]
        if restart == 2:   # another machine joins
            machines.append("late")
            now_s["late"] = max(now_s.values())
        path.write_text(SCENARIO.format(more=(TALL if restart == 2 else "") + soil + synced))
        with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
            for _ in range(3):
                machine = rng.choice(machines)
                y = {"digger": 0.0, "plate": 5.0, "late": 10.0}[machine] + rng.uniform(-0.5, 0.5)
                begin_s = now_s[machine] + rng.uniform(60, 2400)
                to_m = rng.choice([4.0, 5.5])   # beside the truck, or over it
                states = list(cycle(machine, y, begin_s, rng.uniform(0.5, 40), rng.random() < 0.8, to_m))
                last_s = states[-1]["time"]
                if rng.random() < 0.3:   # positions got worse: it is placed, or stays
                    for state in states[12:]:
                        state["fix"] = "rtk_float"
                server.feed(states[:1])   # refused once if it is an hour ahead
                feed(server, states)
                now_s[machine] = last_s
                if rng.random() < 0.4:   # its clock was an hour ahead
                    feed(server, [{"machine": machine, "clock": "reset"}])
                    now_s[machine] = last_s - 3600
            before = require_sums(server, bool(soil))
            if rng.random() < 0.5:
                server.kill()
            else:
                server.stop()
        with Server(tmp_path / "out", cwd=tmp_path) as server:
            assert require_sums(server, bool(soil)) == before, "the recording alone says the same"


def test_soil_that_falls_into_a_truck_is_hauled_by_its_machine_in_its_period(tmp_path):
    path = scenario(tmp_path, SOIL + HOPPERS + "output: {journal: {sync: always}}\n")
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, cycle("digger", 0.0, 100.0, to_m=5.5))
        feed(server, cycle("digger", 3.0, 3700.0, to_m=4.0))
        require_sums(server)
        rows = report(server)
        server.kill()
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert report(server) == rows, "counted again from the recording"
        first, second = [row for row in rows if row["machine"] == "digger" and row["span"] == "period"]
        assert float(first["hauled_m3_loose"]) > 0.2 and float(second["hauled_m3_loose"]) == 0
        assert float(first["put_down_m3_loose"]) >= float(first["hauled_m3_loose"])
        assert (first["from_s"], first["to_s"], second["to_s"]) == ("0", "3600", "7200")
        for row in (first, second):
            assert row["cycles"] == "1" and 0.1 < float(row["load_factor"]) < 2
            assert float(row["last_state_s"]) - float(row["first_state_s"]) == 32
        assert first["first_state_s"] == "100"


def test_work_by_a_clock_that_was_ahead_counts_when_it_was_right_again(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, cycle("plate", 5.0, 100.0))
        feed(server, cycle("digger", 0.0, 3000.0))
        feed(server, [{"machine": "digger", "clock": "reset"}])
        feed(server, cycle("digger", 3.0, 200.0))
        for row in report(server, "?every=60"):
            assert float(row["to_s"]) <= 300
            if row["machine"] == "digger" and row["from_s"] == "180" and row["span"] == "period":
                assert row["cycles"] == "2" and row["first_state_s"] == "200"
        require_sums(server)


def test_a_machine_works_is_idle_or_silent(tmp_path):
    """Works for 100 s, stands for 200 s, is silent for an hour, and works for 50 s."""
    def states():
        for i in range(351):
            far = 0.05 * min(i, 100) + (0.05 * (i - 300) if i > 300 else 0)
            yield {"machine": "digger", "time": 30.0 + i + (3500 if i > 300 else 0),
                   "position": [far, 0, 2], "rotation": turned(0)}
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, states())
        total = report(server, "?every=60")[-3]
        assert (total["machine"], total["span"]) == ("digger", "total")
        assert float(total["working_s"]) == pytest.approx(100 + 10 + 49, abs=2)
        assert float(total["idle_s"]) == pytest.approx(190, abs=2)
        minutes = [row for row in report(server, "?every=60") if row["machine"] == "digger"][:-1]
        for row in minutes:
            assert float(row["working_s"]) + float(row["idle_s"]) <= 60 + 1e-6


def test_periods_are_whole_multiples_and_ends_are_cut_off(tmp_path):
    begin = datetime(2026, 11, 27, 6, 50, tzinfo=timezone.utc).timestamp()
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, cycle("digger", 0.0, begin, step_s=50))
        hours = [row for row in report(server) if row["machine"] == "all" and row["span"] == "period"]
        assert [(row["from_utc"], row["to_utc"]) for row in hours] == [
            ("2026-11-27T06:00:00Z", "2026-11-27T07:00:00Z"),
            ("2026-11-27T07:00:00Z", "2026-11-27T08:00:00Z")]
        part = report(server, f"?from={begin + 130}&to={begin + 1000}&every=900")
        ends = [(row["from_utc"][11:16], row["to_utc"][11:16]) for row in part if row["machine"] == "all"]
        assert ends == [("06:52", "07:00"), ("07:00", "07:07"), ("06:52", "07:07")]
        assert float(part[-1]["cut_m3_bank"]) < float(report(server)[-1]["cut_m3_bank"])


def test_units_are_in_the_headers_and_are_those_of_the_trade(tmp_path):
    """Of any choice and in any order, by the exact definitions; bank and loose differ by swell."""
    rng = random.Random(61)
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, cycle("digger", 0.0, 0.0))
        counted = report(server)[-1]
        m3 = {"cut": ("bank", float(counted["cut_m3_bank"])), "put_down": ("loose", float(counted["put_down_m3_loose"]))}
        assert all(value > 0 for _, value in m3.values())
        for _ in range(12):
            volume, mass = rng.choice(["m3", "yd3"]), rng.choice(["t", "short_tons"])
            soil, length = rng.choice(["counted", "bank", "loose"]), rng.choice(["m", "ft", "us_ft"])
            words = [volume, mass, soil, length]
            rng.shuffle(words)
            row = report(server, "?units=" + ",".join(words))[-1]
            for name, (is_soil, value) in m3.items():
                wanted = is_soil if soil == "counted" else soil
                if wanted != is_soil:
                    value = value * (BANK_UNITS / UNITS_PER_SAMPLE) ** (1 if wanted == "loose" else -1)
                value /= {"m3": 1, "yd3": 0.9144 ** 3}[volume]
                assert float(row[f"{name}_{volume}_{wanted}"]) == pytest.approx(value, rel=1e-14), (words, name)
            kg = float(counted["load_t"]) * 1000
            assert float(row[f"load_{mass}"]) == pytest.approx(kg / {"t": 1000, "short_tons": 907.18474}[mass], rel=1e-14)
            page = server.get("/report?units=" + ",".join(words))[1].decode()
            links = re.findall(r'href="report[.]csv([^"]*)"', page)
            assert report(server, links[0].replace("&amp;", "&"))[-1] == row, "its link keeps the units"
            if length != "m":
                assert re.search(rf'href="./#units={length},', page), "so does the one to the live page"


def test_units_of_the_page_are_in_its_headers(tmp_path):
    with Server(scenario(tmp_path, SOIL), "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, cycle("digger", 0.0, 0.0))
        metric, us = report(server)[-1], report(server, "?units=short_tons,yd3")[-1]
        assert float(us["cut_yd3_bank"]) == pytest.approx(float(metric["cut_m3_bank"]) / 0.9144 ** 3)
        assert float(us["load_short_tons"]) == pytest.approx(float(metric["load_t"]) / 0.90718474)
        assert "cut_yd3_bank" in report(server, "?units=yd3")[0] and "load_t" in report(server, "?units=yd3")[0]
        page = server.get("/report?units=yd3,short_tons")[1].decode()
        assert "yd³ bank" in page and "short tons" in page and "m³ bank" not in page


def test_a_bad_query_is_told_what_is_wrong_and_what_would_be_right(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert report(server)[-1]["cut_m3_bank"] == "0", "nothing is dug yet"
        feed(server, cycle("plate", 0.0, 1000.0))
        for query, words in (("every=0", "3600"), ("every=90", "whole minutes"), ("every=x", "numbers"),
                             ("from=5&to=5", "before"), ("from=9000", "later than"), ("to=10", "recorded"),
                             ("units=feet", "yd3"), ("units=bank", "swell"), ("units=loose,bank", "most one"), ("units=yd3,", "most one"), ("units=m3,yd3", "at most one"), ("hour=1", "unknown")):
            for path in ("/report", "/report.csv"):
                status, body = server.get(f"{path}?{query}")
                assert status == 400, query
                error = json.loads(body)["error"]
                assert words in error and "\n" not in error, (query, error)


def test_who_may_look_may_ask_and_links_keep_the_token(tmp_path):
    with Server(scenario(tmp_path), "--out", tmp_path / "out", "--token", "feeds", "--view-token", "looks",
                cwd=tmp_path) as server:
        looks = {"Authorization": "Bearer looks"}
        assert server.get("/report")[0] == server.get("/report.csv?token=no")[0] == 401
        assert server.get("/report.csv", looks)[0] == 200
        status, body = server.get("/report?token=looks")
        assert status == 200
        links = re.findall(r'href="(report[^"]*)"', body.decode())
        assert links
        for link in links:
            assert server.get("/" + link.replace("&amp;", "&"))[0] == 200, link


def test_a_finished_run_is_reported_but_for_what_it_did_not_record(tmp_path):
    """A run's journal does not tell which machine a hopper's soil came from."""
    path = tmp_path / "run.yaml"
    path.write_text(SCENARIO.split("  - name: plate")[0].format() + "    motion: digger.csv\n" + SOIL + HOPPERS)
    rows = (",".join(str(value) for value in (state["time"], *state["position"], *state["rotation"]))
            for state in cycle("digger", 0.0, 0.0, to_m=5.5))
    (tmp_path / "digger.csv").write_text("time,x,y,z,qx,qy,qz,qw\n" + "\n".join(rows) + "\n")
    subprocess.run([PROGRAM, "run", path, "--out", tmp_path / "out", "--no-mesh"], check=True, capture_output=True)
    with Server(tmp_path / "out", cwd=tmp_path) as server:
        volumes = server.json("/summary.json")["volume_m3"]
        total = report(server)[-1]
        assert volumes["hauled"] > 0.1 and total["hauled_m3_loose"] == ""
        assert float(total["cut_m3_bank"]) == volumes["cut"]
        assert float(total["put_down_m3_loose"]) == volumes["spilled"]
        assert float(total["working_s"]) == pytest.approx(32, abs=1e-3)


class Page(HTMLParser):
    """The words of a page, and its tags."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.words = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in ("meta", "br", "rect", "path"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert tag in ("rect", "path") or self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data.strip())


def test_the_page_has_the_figures_of_the_table_and_needs_no_script(tmp_path):
    path = tmp_path / "site.yaml"
    path.write_text(SCENARIO.format(more=SOIL + HOPPERS).replace("digger", "'Liebherr <R 938> & Co'"))
    with Server(path, "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert "no states" in server.get("/report")[1].decode()
        feed(server, cycle("Liebherr <R 938> & Co", 0.0, 100.0, to_m=5.5))
        feed(server, cycle("Liebherr <R 938> & Co", 3.0, 3700.0))
        status, body = server.get("/report")
        assert status == 200
        page = Page(body.decode())
        assert not page.open and "script" not in page.tags
        assert page.tags.count("figure") == 2 and "svg" in page.tags
        assert "Liebherr <R 938> & Co" in page.words
        for row in report(server):
            if row["machine"] != "plate":
                for column in ("cut_m3_bank", "put_down_m3_loose", "hauled_m3_loose", "load_t"):
                    assert f"{float(row[column]):.3f}" in page.words, (column, row)


def test_a_report_holds_no_feed(tmp_path):
    """A week is reported in milliseconds, because nothing is dug again."""
    with Server(scenario(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        feed(server, ({"machine": "digger", "time": 30.0 * i, "position": [0.1 * (i % 50), 0, 1],
                       "rotation": turned(0)} for i in range(20000)))
        begin = time.monotonic()
        assert len(report(server)) == 3 * 167 + 3
        assert time.monotonic() - begin < 1
