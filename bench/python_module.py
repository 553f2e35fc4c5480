# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What Python costs over C++, and how sites scale: each figure beside its goal.

Each part runs in processes with one and with two cores.
"""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np

from goals import dug_site, measured, median, report


def measure(quick):
    import soilvdb

    n = 400 if quick else 40000
    figures = {}
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(width=1.2, height=0.9)])
    poses = [(0.001 * (i % 5000), 0.0, 5 + 0.001 * (i % 7)) for i in range(n)]
    level, array = (0.0, 0.0, 0.0, 1.0), np.array(poses)
    turns = np.tile(level, (n, 1))

    def one_by_one():
        for position in poses:
            site.update(0, position=position, rotation=level)

    python = median(5, one_by_one)
    loop = median(5, lambda: site.update_path(0, positions=array, rotations=turns))
    figures["over_us"] = (python - loop) / n * 1e6

    dug = dug_site(soilvdb)
    side = 100 if quick else 1000
    xy = np.stack(np.meshgrid(np.linspace(-3, 3, side), np.linspace(-3, 3, side)), -1).reshape(-1, 2)
    begin = time.perf_counter()
    dug.mesh_heights(xy)
    figures["first_heights_s"] = (time.perf_counter() - begin) * 1e6 / len(xy)
    figures["heights_s"] = median(3, lambda: dug.mesh_heights(xy)) * 1e6 / len(xy)
    figures["clone_ms"] = 1e3 * median(51, dug.clone)
    moved = dug_site(soilvdb, soilvdb.Soil(0.61, 0.25))
    figures["clone_moving_ms"] = 1e3 * median(51, moved.clone)

    count, steps = (8, 5) if quick else (256, 100)
    clones = [dug.clone() for _ in range(count)]
    depth = np.linspace(0.2, 0.6, count)
    begin = time.perf_counter()
    for s in np.linspace(0, 1, steps):
        at = np.stack([-2 + 4 * s + 0 * depth, 3 + 0 * depth, 0.3 - (0.3 + depth) * min(5 * s, 1)], 1)
        soilvdb.update_many(clones, 0, positions=at)
    figures["many_s"] = time.perf_counter() - begin
    return figures


def main():
    one, two, out = measured("python", measure)
    importing = median(5, lambda: subprocess.run([sys.executable, "-c", "import soilvdb"], check=True))
    rows = [
        ("Python over C++, per update by poses", one["over_us"], "us", "<= 2"),
        ("mesh_heights of 10^6 points on a dug site, 1 thread", one["heights_s"], "s", "<= 0.5"),
        ("the same, the first time", one["first_heights_s"], "s", ""),
        ("the same, 2 threads over 1", one["heights_s"] / two["heights_s"], "", ">= 1.7"),
        ("clone of a dig of 20 m2 at 5 cm", one["clone_ms"], "ms", "<= 1"),
        ("the same of soil that moves", one["clone_moving_ms"], "ms", "<= 1"),
        ("256 clones, 100 updates each, 2 threads over 1", one["many_s"] / two["many_s"], "", ">= 1.7"),
        ("import soilvdb", importing, "s", "<= 0.3"),
    ]
    report(rows, out)


if __name__ == "__main__":
    main()
