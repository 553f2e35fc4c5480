# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What it costs to look at the ground, from Python: each figure beside its goal, and beside a NumPy
array of heights with equal cells. Each part runs in processes with one and with two cores."""

from __future__ import annotations

import csv
import math
import statistics
import time

import numpy as np

from goals import PROFILE, dug_site, measured, report

MAP_S = 250e-6   # goal for a map of cells of other sizes than the voxels'


def drag(step):
    """Position and rotation of a machine that digs strokes of 4 m, 0.3 m deep, at 100 Hz, lifts, and
    goes back above the ground."""
    stroke, at = divmod(step, 800)
    back = max(0.0, at - 600) / 200
    down = min(1.0, at / 50)
    high = 1.5 * min(1.0, max(0.0, at - 500) / 100) if at > 500 else 1.5 * (1 - down)
    pitch = 0.3 - 1.8 * min(1.0, max(0.0, at - 450) / 150) * (1 - back)
    lane = stroke % 3 + ((stroke + 1) % 3 - stroke % 3) * back
    return ((2 - 4 * back if back else -2 + 4 * min(at, 500) / 500, 1.3 * lane,
             -0.05 * stroke - 0.3 * down + high), (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)))


def looks(soilvdb, quick):
    """Median times of a look after each update of a dig in soil that moves, each in a dig of its own,
    us; misfit of volumes."""
    into = np.empty((64, 64), np.float32)
    array, window = np.zeros((400, 400), np.float32), np.empty((64, 64), np.float32)

    def numpy_window(_, p):
        i, j = int((p[1] + 10) / 0.05), int((p[0] + 10) / 0.05)
        window[:] = array[i - 32:i + 32, j - 32:j + 32]

    kinds = {
        "one height": lambda site, p: site.heights([(p[0] + 0.3, p[1])]),
        "map, cells of the voxels": lambda site, p: site.height_map(
            origin=(round(p[0] / 0.05) * 0.05 - 1.6, round(p[1] / 0.05) * 0.05 - 1.6),
            shape=(64, 64), cell=0.05, out=into),
        "map, cells of 10 cm": lambda site, p: site.height_map(
            origin=(p[0] - 3.2, p[1] - 3.2), shape=(64, 64), cell=0.1, out=into),
        "map turned with the machine, 5 cm": lambda site, p: site.height_map(
            machine=0, shape=(64, 64), cell=0.05, out=into),
        "map turned with the machine, 10 cm": lambda site, p: site.height_map(
            machine=0, shape=(64, 64), cell=0.1, out=into),
        "height on the mesh": lambda site, p: site.mesh_heights([(p[0] + 0.3, p[1])]),
        "NumPy window": numpy_window,
    }
    figures = {}
    for name, look in kinds.items():
        site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)],
                            soil=soilvdb.Soil(0.61, 0.25))
        times = []
        for step in range(100 if quick else 2400):
            position, rotation = drag(step)
            site.update(0, position=position, rotation=rotation, time=step / 100)
            begin = time.perf_counter()
            look(site, position)
            if step % 800 < 600:  # on its way back it changes nothing
                times.append(1e6 * (time.perf_counter() - begin))
        figures[name] = statistics.median(times)
        if name == "map, cells of the voxels":
            figures["slowest map"] = max(times[3:])
    dug = site.height_map(origin=(-8, -8), shape=(320, 320), cell=0.05, layer="dug")
    sample_m3 = 0.05**3 / 64
    figures["misfit"] = abs(dug.sum() * 0.05**2 + site.change_m3()) / sample_m3
    return figures


def many_points(soilvdb, quick):
    """10^6 points of a dug site: the first time and later, s."""
    site = dug_site(soilvdb)
    count = 10**4 if quick else 10**6
    xy = np.random.default_rng(1).uniform(-3, 3, (count, 2))
    took = []
    for _ in range(4):
        begin = time.perf_counter()
        site.heights(xy)
        took.append((time.perf_counter() - begin) * 1e6 / count)
    return {"first points": took[0], "points": statistics.median(took[1:])}


def depth_images(soilvdb, quick):
    """A depth image of 640 x 480 of a dug site, from 4 m above and 40 degrees down: the first, after an
    update, and again, ms."""
    site = dug_site(soilvdb, soilvdb.Soil(0.61, 0.25))
    u, v = np.meshgrid(np.arange(640) - 319.5, np.arange(480) - 239.5)
    down = math.radians(40)
    ahead, up = np.array([math.cos(down), 0, -math.sin(down)]), np.array([math.sin(down), 0, math.cos(down)])
    ways = 550 * ahead - v[..., None] * up - u[..., None] * np.array([0.0, 1, 0])
    eye = (-4.5, 0.0, 4.0)

    def image():
        begin = time.perf_counter()
        ranges = site.cast(eye, ways)
        took = 1000 * (time.perf_counter() - begin)
        assert np.isfinite(ranges).mean() > 0.9
        return took

    first, after, again = image(), [], []
    for n in range(3 if quick else 15):
        site.update(0, position=(-1 + 0.1 * n, 0, -0.4))
        after.append(image())
        again.append(image())
    return {"first image": first, "image": statistics.median(after),
            "image again": statistics.median(again)}


def environment(soilvdb, soil, quick):
    """Steps a second of 64 sites at 10 cm: an update, a 16 x 16 map around the lip, a reward."""
    count, steps = 64, 8 if quick else 240
    env = soilvdb.VectorSite(
        soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)], soil=soil), count)
    maps, loads = np.empty((count, 16, 16), np.float32), np.zeros(count)
    depth = np.linspace(0.1, 0.4, count)
    begin = time.perf_counter()
    for step in range(steps):
        if step % 60 == 0:
            env.reset()
            loads = np.zeros(count)
        s = step % 60 / 60
        pitch = 0.3 - 1.8 * max(0.0, s - 0.75) / 0.25
        at = np.stack([4 * s + 0 * depth, 0 * depth, 0.1 - depth * min(1, 5 * s) + 8 * max(0, s - 0.8)], 1)
        turn = np.tile([0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2)], (count, 1))
        given = env.step(0, positions=at, rotations=turn)
        env.height_map(machine=0, shape=(16, 16), cell=0.2, out=maps)
        rewards, loads = given.bucket_m3 - loads, given.bucket_m3
    assert np.isfinite(maps).all() and np.isfinite(rewards).all() and not given.errors
    return count * steps / (time.perf_counter() - begin)


def controller(soilvdb, quick):
    """A loop at 1 kHz in soil that moves, with a 32 x 32 map each step: how many steps took how long,
    in bins that double from 16 us, and how many maps; steps over 1 ms. A map of cells that aren't the
    voxels' may take MAP_S, so an update that leaves less of the millisecond makes its step late; other
    late steps are the map's, by the time of its thread, without that in which the system ran other
    programs. Also how many steps were late though their update was not, and the shortest of these
    updates."""
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)],
                        soil=soilvdb.Soil(0.61, 0.25))
    into, steps = np.empty((32, 32), np.float32), 600 if quick else 36000
    update, look, work = np.zeros(steps), np.zeros(steps), np.zeros(steps)
    for step in range(steps):
        position, rotation = drag(step / 10)
        begin = time.perf_counter()
        site.update(0, position=position, rotation=rotation, time=step / 1000)
        between, busy = time.perf_counter(), time.thread_time()
        site.height_map(machine=0, shape=(32, 32), cell=0.1, out=into)
        work[step] = time.thread_time() - busy
        update[step], look[step] = between - begin, time.perf_counter() - between
    whole = update + look

    def histogram(times):
        bins = np.clip(np.ceil(np.log2(times / 16e-6)), 0, 11).astype(int)
        return np.bincount(bins, minlength=12).tolist()

    late = update + work > 0.001
    both = late & (update <= 0.001)
    return {"steps": histogram(whole), "maps": histogram(look), "count": steps,
            "late": int((whole > 0.001).sum()),
            "late by both": int(both.sum()),
            "late by map": int((late & (update <= 0.001 - MAP_S)).sum()),
            "least update": 1000 * float(update[both].min()) if both.any() else math.nan,
            "longest work": 1e6 * float(work[1:].max())}


def measure(quick):
    import soilvdb

    figures = looks(soilvdb, quick) | many_points(soilvdb, quick) | depth_images(soilvdb, quick)
    figures["rigid"] = environment(soilvdb, None, quick)
    figures["moving"] = environment(soilvdb, soilvdb.Soil(0.61, 0.25), quick)
    figures |= controller(soilvdb, quick)
    return figures


def main():
    one, two, out = measured("observe", measure)
    after = "after an update, 5 cm, moving soil"
    rows = [
        (f"one height {after}", two["one height"], "us", "<= 5"),
        (f"64 x 64 map {after}: cells of the voxels", two["map, cells of the voxels"], "us", "<= 60"),
        ("the slowest of these", two["slowest map"], "us", ""),
        ("64 x 64 map: cells of 10 cm, anywhere", two["map, cells of 10 cm"], "us", "<= 250"),
        ("64 x 64 map around the machine: 5 cm", two["map turned with the machine, 5 cm"], "us", "<= 250"),
        ("64 x 64 map around the machine: 10 cm", two["map turned with the machine, 10 cm"], "us", "<= 250"),
        ("a 64 x 64 window of a NumPy array", two["NumPy window"], "us", ""),
        (f"one height on the mesh {after}", two["height on the mesh"], "us", ""),
        ("10^6 points of a dug site", two["points"], "s", "<= 0.05"),
        ("the same, the first time", two["first points"], "s", "<= 0.05"),
        ("depth image of 640 x 480 of a dug site, after an update", two["image"], "ms", "<= 20"),
        ("the same again", two["image again"], "ms", ""),
        ("the first", two["first image"], "ms", ""),
        ("64 sites, rigid, 10 cm: steps with a 16 x 16 map", two["rigid"], "1/s", ">= 20000"),
        ("the same, 2 cores over 1", two["rigid"] / one["rigid"], "", ">= 1.8"),
        ("64 sites, moving soil, 10 cm: the same", two["moving"], "1/s", ">= 4000"),
        ("the same, 2 cores over 1", two["moving"] / one["moving"], "", ">= 1.8"),
        (f"a loop at 1 kHz, moving soil, 5 cm, a 32 x 32 map each step: of {two['count']} steps over 1 ms",
         two["late"], "", ""),
        ("the same, after an update that left the map 250 us or more", two["late by map"], "", "<= 0"),
        ("the same, after an update of up to 1 ms", two["late by both"], "", ""),
        ("the shortest of these updates", two["least update"], "ms", ""),
        ("the longest CPU time of such a map", two["longest work"], "us", "<= 250"),
        ("sum over a map against the ground's volume", two["misfit"], "samples", "<= 0.01"),
    ]
    report(rows, out)
    print("\nsteps of the loop at 1 kHz, and their maps, by duration:")
    with open(out / "steps.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["to_ms", "steps", "maps"])
        for n, (steps, maps) in enumerate(zip(two["steps"], two["maps"])):
            to = 16 * 2**n / 1000 if n < 11 else math.inf
            writer.writerow([to, steps, maps])
            print(f"  to {to:7.3f} ms {steps:7} {maps:7} {'#' * math.ceil(60 * steps / max(two['steps']))}")


if __name__ == "__main__":
    main()
