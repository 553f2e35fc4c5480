# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many jobs: what one costs beyond its own run, workers side by side, and a table after kills."""

from __future__ import annotations

import argparse
import csv
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/fleet"))

from processes import FLEET, Processes, done_count, fleet_run, lasting, write_jobs

from soilvdb.fleet import jobs
from soilvdb.fleet.cluster import open_cluster, run_tasks
from soilvdb.fleet.manifest import read_manifest
from soilvdb.fleet.tables import write_tables


def timed_job(job):
    """@return the result, and how long the program ran, s"""
    dig, seconds = jobs._dig, []

    def timed_dig(*arguments):
        begin = time.perf_counter()
        dig(*arguments)
        seconds.append(time.perf_counter() - begin)

    jobs._dig = timed_dig
    try:
        return jobs.run_job(job), sum(seconds)
    finally:
        jobs._dig = dig


def overhead(scratch, count):
    """@return per job beyond its own run, from the first to the table, s; to start workers, s"""
    manifest = write_jobs(scratch, [{"job": f"j{i}", "updates": 20} for i in range(count)])
    listed = read_manifest(manifest, scratch / "out")
    begin = time.perf_counter()
    with open_cluster(1, None) as cluster:
        started = time.perf_counter()
        results, own = {}, 0.0
        for outcome in run_tasks(cluster, timed_job, listed):
            if outcome.error:
                raise outcome.error
            results[listed[outcome.index].name], seconds = outcome.value
            own += seconds
        write_tables(scratch / "out", listed, results, {})
        done = time.perf_counter()
    return (done - started - own) / count, started - begin


def side_by_side(scratch, count, updates):
    """@return by how much two workers are faster than one, start and table included"""
    manifest = write_jobs(scratch, [{"job": f"j{i}", "updates": updates} for i in range(count)])
    times = []
    for workers in (1, 2):
        begin = time.perf_counter()
        done = fleet_run(manifest, scratch / f"out{workers}", "--workers", workers)
        times.append(time.perf_counter() - begin)
        assert done.returncode == 0, done.stderr
    return times[0] / times[1]


def killed(scratch, count, kills, restarts):
    """Kills workers at random, and the scheduler as often as said, while jobs are dug.

    @return workers killed, schedulers killed, rows that a serial run has otherwise or not
    """
    chance = random.Random(18)
    manifest = write_jobs(scratch, [{"job": f"j{i}", "updates": chance.choice([40, 400, 40_000])}
                                    for i in range(count)])
    out, dead, restarted = scratch / "out", 0, 0
    with Processes(scratch, hosts=(1, 1, 1, 1)) as cluster:
        process = subprocess.Popen(
            [*FLEET, "run", manifest, "--out", out, "--scheduler", cluster.address],
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        while process.poll() is None:
            done = done_count(out)
            if dead < kills and done >= (dead + 1) * count * 0.9 / kills:
                chance.choice(cluster.workers).kill()
                dead += 1
            if restarted < restarts and done >= (restarted + 1) * count / (restarts + 1):
                cluster.scheduler.kill()
                restarted += 1
            time.sleep(0.05)
        assert process.returncode == 0, process.stderr.read()
    for job in read_manifest(manifest, scratch / "serial"):
        jobs.run_job(job)
    fleet_run(manifest, scratch / "serial", "--gather")
    found, wanted = (lasting(folder / "results.csv").splitlines()
                     for folder in (out, scratch / "serial"))
    wrong = sum(a != b for a, b in zip(found, wanted)) + abs(len(found) - len(wanted))
    return dead, restarted, wrong


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out/bench/fleet"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        small, medium, many = (20, 8, 16) if options.quick else (1000, 200, 500)
        per_job_s, start_s = overhead(scratch / "small", small)
        speedup = side_by_side(scratch / "medium", medium, 20_000 if options.quick else 60_000)
        dead, restarted, wrong = killed(scratch / "many", many, *((4, 1) if options.quick else
                                                                  (50, 2)))
    rows = [
        (f"{small} small jobs: per job beyond its own run", 1e3 * per_job_s, "ms", "<= 30"),
        ("to start workers, once", start_s, "s", ""),
        (f"{medium} jobs, 2 workers over 1", speedup, "", ">= 1.8"),
        (f"{many} jobs: workers killed meanwhile", dead, "", ""),
        ("schedulers killed and started again meanwhile", restarted, "", ""),
        ("rows that a serial run has otherwise", wrong, "", "<= 0"),
    ]
    options.out.mkdir(parents=True, exist_ok=True)
    with open(options.out / "goals.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["figure", "measured", "unit", "goal"])
        for name, value, unit, goal in rows:
            writer.writerow([name, f"{value:.4g}", unit, goal])
    for name, value, unit, goal in rows:
        verdict = ""
        if goal:
            limit = float(goal.split()[1])
            verdict = "PASS" if (value <= limit if goal[0] == "<" else value >= limit) else "miss"
        print(f"{name:50} {value:10.4g} {unit:3} {goal:7} {verdict}")
    if wrong:
        sys.exit("a table is wrong")


if __name__ == "__main__":  # workers import this module by another name
    main()
