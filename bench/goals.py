# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What the benchmarks of the Python module share: processes with so many cores, the table of goals."""

from __future__ import annotations

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]


def median(count, f):
    times = []
    for _ in range(count):
        begin = time.perf_counter()
        f()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


def dug_site(soilvdb, soil=None):
    """20 m2 dug in passes side by side, 5 cm voxels."""
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)], soil=soil)
    x = np.linspace(-2.2, 2.2, 60)
    for y in np.arange(-1.8, 1.9, 1.2):
        path = np.stack([x, y + 0 * x, 0.5 - np.clip(4 * (2.2 - np.abs(x)), 0, 0.8)], axis=1)
        site.update_path(0, positions=path)
    return site


def measured(name, measure):
    """Figures of measure(quick) in a process with one core and in one with two; whether it is quick,
    and the folder for the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("out/bench") / name)
    parser.add_argument("--cores", type=int)
    options = parser.parse_args()
    if options.cores:
        os.sched_setaffinity(0, set(range(options.cores)))   # before the engine counts them
        print(json.dumps(measure(options.quick)))
        sys.exit()

    def child(cores):
        done = subprocess.run([sys.executable, sys.argv[0], "--cores", str(cores)]
                              + ["--quick"] * options.quick,
                              check=True, capture_output=True, text=True)
        return json.loads(done.stdout)

    return child(1), child(2), options.out


def report(rows, out):
    """Prints rows (figure, measured, unit, goal) with verdicts, and keeps them in goals.csv. A goal is
    "<= 1", ">= 1", "0.8 .. 1.3" or empty."""
    out.mkdir(parents=True, exist_ok=True)
    with open(out / "goals.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["figure", "measured", "unit", "goal"])
        for name, value, unit, goal in rows:
            writer.writerow([name, f"{value:.4g}", unit, goal])
    wide, tall = (max(8 * (k == 3), *(len(row[k]) for row in rows)) for k in (0, 3))
    for name, value, unit, goal in rows:
        verdict = ""
        if ".." in goal:
            low, high = (float(limit) for limit in goal.split(".. "))
            verdict = "PASS" if low <= value <= high else "miss"
        elif goal:
            limit = float(goal.split()[1])
            verdict = "PASS" if (value <= limit if goal[0] == "<" else value >= limit) else "miss"
        print(f"{name:{wide}} {value:10.4g} {unit:7} {goal:{tall}} {verdict}")
