# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many jobs: what one costs beyond its own run, workers side by side, and a table after kills;
how well loads are known, against closed forms and digs whose truth is known."""

from __future__ import annotations

import argparse
import json
import multiprocessing
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests/fleet"))

import closed_forms
import numpy as np
from goals import report
from processes import FLEET, Processes, done_count, fleet_run, lasting, write_jobs

import soilvdb
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


CASES = (("a height's bias on a flat pass", closed_forms.flat_pass, 0.01, 1, 0.05),
         ("systematic error of a terrain", closed_forms.systematic_terrain, 0.01, 0.4, 0.05),
         ("uncorrelated error of a terrain", closed_forms.uncorrelated_terrain, 0.02, 0.4, 0.1),
         ("correlated error of a terrain", closed_forms.correlated_terrain, 0.02, 0.4, 0.1),
         ("drift of a height", closed_forms.drifting_height, 0.01, 1, 0.1),
         ("white noise of a height", closed_forms.white_height, 0.005, 1, 0.1),
         ("a bucket's width", closed_forms.wide_bucket, 0.01, 0.4, 0.05))


def known_case(task):
    """@return the case's sigma over the right one, less 1, in %; the goal, sampling error included"""
    scratch, number, draws = task
    title, case, sigma, share, within = CASES[number]
    found = case(scratch / case.__name__, sigma, max(20, round(share * draws)))
    return title, 100 * abs(found.ratio - 1), 100 * (within + 3 / (2 * found.draws)**0.5)


def covered(task):
    return closed_forms.covered(*task)


def ensemble_cost():
    """@return an update of a site with 16 clones over one of the site alone, in medians of turns"""
    ratios = []
    for _ in range(9):
        times = []
        for clones in (0, 16):
            site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
            fed = site if not clones else soilvdb.Ensemble(
                site, {"position": {"bias": 0.01, "drift": {"sigma": 0.01, "tau": 300},
                                    "white": 0.001}}, clones=clones)
            begin = time.perf_counter()
            for k in range(250):
                fed.update(0, position=(0.01 * k, 0, -0.25), rotation=(0, 0, 0, 1), time=0.02 * k)
            times.append(time.perf_counter() - begin)
        ratios.append(times[1] / times[0])
    return float(np.median(ratios))


def uncertainty(scratch, draws, scenarios):
    """Rows of how well loads are known."""
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        cases = pool.map(known_case, [(scratch, i, draws) for i in range(len(CASES))], 1)
        parts = pool.map(covered, [(scratch / f"truths{i}", scenarios // 4, 100, 1000 * i)
                                   for i in range(4)], 1)
    passes = closed_forms.repeated_passes(scratch / "passes", 0.01, min(draws, 200))
    inside = 100 * float(np.mean(parts))
    return [(f"sigma, {title}: off by", off, "%", f"<= {goal:.3g}") for title, off, goal in cases
            ] + [
        (f"truths of {scenarios // 4 * 4} digs within 5..95 %: off 90 % by", abs(inside - 90), "%",
         "<= 6"),
        ("a constant bias, first pass over the closed form", float(passes[0]), "", ""),
        ("the same, worst of the passes after it", float(max(passes[1:])), "", "<= 0.02"),
        ("16 clones beside a site: updates of it alone", ensemble_cost(), "", "<= 16")]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out/bench/fleet"))
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        small, medium, many = (4, 4, 6) if options.quick else (1000, 200, 500)
        per_job_s, start_s = overhead(scratch / "small", small)
        speedup = side_by_side(scratch / "medium", medium, 2_000 if options.quick else 60_000)
        known = uncertainty(scratch / "known", 12 if options.quick else 1000,
                            4 if options.quick else 100)
        dead, restarted, wrong = killed(scratch / "many", many, *((1, 1) if options.quick else
                                                                  (50, 2)))
    rows = [
        (f"{small} small jobs: per job beyond its own run", 1e3 * per_job_s, "ms", "<= 30"),
        ("to start workers, once", start_s, "s", ""),
        (f"{medium} jobs, 2 workers over 1", speedup, "", ">= 1.8"),
        (f"{many} jobs: workers killed meanwhile", dead, "", ""),
        ("schedulers killed and started again meanwhile", restarted, "", ""),
        ("rows that a serial run has otherwise", wrong, "", "<= 0"),
        *known,
    ]
    report(rows, options.out)
    if wrong:
        sys.exit("a result is wrong")


if __name__ == "__main__":  # workers import this module by another name
    main()
