# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What scans tell of the ground: errors and claims over random digs, laws, cost, and maps of heights
that others make of the same rays. --development draws from the seeds that may be worked with."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import math
import multiprocessing
import os
import statistics
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from goals import PROFILE, report
from sensing_rivals import GATE, CellKalman, CellMean, check_kalman
from sensing_scenes import (CELL, COLUMN, COLUMNS, DEVELOPMENT_SEEDS, FIRST, HELD_OUT_SEEDS, LIP,
                            ORIGIN, WIDTH, Frames, Scene, camera, cast, columns_of, lidar,
                            quaternion, turned)

FRAMES = 10
STEP = 0.1          # between neighbouring columns, m: a step
NEAR = 3            # columns about a step or a slump
MOVES = (0.01, 0.03), (0.002, 0.008)   # sigmas of a moving sensor's poses: m, rad
AWAY = 5.0          # of it from the trench's middle, m
RIGS = {"camera": camera, "lidar": lidar}
KINDS = ("natural", "floor", "near", "heap")
MAPS = ("fused", "kalman", "mean")


def columns(soilvdb, site):
    return site.height_map(origin=FIRST, shape=COLUMNS, cell=COLUMN)


def places():
    rows, cols = COLUMNS
    return np.meshgrid(FIRST[0] + COLUMN * np.arange(cols), FIRST[1] + COLUMN * np.arange(rows))


def sigmas(site):
    x, y = places()
    return site.heights(np.stack([x.ravel(), y.ravel()], axis=1), sigma=True)[1].reshape(COLUMNS)


def lip_of(survey, name, number):
    """Mean and sigma of a machine's lip error."""
    errors = survey.lip_error
    return errors[name] if hasattr(errors, "keys") else errors[number]


def widened(mask, count):
    for _ in range(count):
        for axis in (0, 1):
            mask = mask | np.roll(mask, 1, axis) | np.roll(mask, -1, axis)
    return mask


def kinds_of(scene, truth, before):
    """Masks of the columns: natural ground, the floor, near steps and slumps, heap; and the trench with
    its walls, whose volume counts."""
    x, y = places()
    s, t = scene.along(x, y)
    steps = np.zeros(COLUMNS, bool)
    for heights in (truth, before):
        for axis in (0, 1):
            jump = np.abs(np.diff(heights, axis=axis)) > STEP
            first, second = ((slice(None, -1), slice(1, None)) if axis == 0 else
                             ((slice(None), slice(None, -1)), (slice(None), slice(1, None))))
            steps[first] |= jump
            steps[second] |= jump
    slumped = columns_of(scene.slumped.astype(float)) > 0
    near = widened(steps | slumped, NEAR)
    dug = columns_of(scene.dug.astype(float))
    heap = np.hypot(x - scene.heap[0], y - scene.heap[1]) < 2.2
    return {"natural": (dug == 0) & ~near & ~heap & (np.abs(s) < scene.half + 4),
            "floor": (dug == 1) & ~near, "near": near, "heap": heap & ~near,
            "trench": (np.abs(s) < scene.half + 0.1) & (np.abs(t) < 1.0)}


def hovering(scene, frame):
    """True pose of the bucket over the trench: position and rotation matrix."""
    s = scene.half * (-0.6 + 1.2 * frame / FRAMES)
    x, y = scene.place(s)
    return (np.array([x, y, scene.slope @ (x, y) + 0.35]),
            turned([0, 0, scene.yaw]) @ turned([0, 0.3, 0]))


def surveyed(soilvdb, scene, site, rig, seed, maps=(), cast_to=None, **noise):
    """Scans of a site, applied. cast_to: Frames whose rays are known already."""
    frames = Frames.__new__(Frames)
    frames.__dict__.update(cast_to.__dict__, rng=np.random.default_rng(seed))
    body = noise.pop("body", False)
    for k in range(FRAMES):
        pose = hovering(scene, k)
        if body:   # the engine is told where it is with the lip's error
            error = np.array([0, 0, float(scene.lip_errors(*pose[0][:2]))])
            site.place("loader", position=pose[0] + error, rotation=quaternion(pose[1]))
        measured = frames.frame(body=(*pose, PROFILE, WIDTH) if body else None, **noise)
        rig.scan(soilvdb, site, measured)
        for each in maps:
            each.scan(*frames.points(measured), rig)
    return site.apply_scans()


def draw(task):
    """Figures of one scene and one sensor."""
    seed, name, quick, hard = task
    import soilvdb

    scene, rig = Scene(seed), RIGS[name](quick)
    site = scene.predicted(soilvdb, PROFILE, rig)
    truth, before = columns_of(scene.truth), columns(soilvdb, site)
    noise_of = (seed, list(RIGS).index(name))   # its seed, apart from the scene's
    frames = Frames(scene, rig, (*noise_of, 0))
    hit, kinds = frames.hits(), kinds_of(scene, truth, before)
    kalman, mean = CellKalman(), CellMean()
    fused = site.clone()
    survey = surveyed(soilvdb, scene, fused, rig, (*noise_of, 1), (kalman, mean), frames)
    after, sigma = columns(soilvdb, fused), sigmas(fused)
    lip, lip_sigma = lip_of(survey, "digger", 0)
    way = np.linspace(-scene.half, scene.half, 50)
    out = {"seed": seed, "sensor": name, "lip": scene.lip_error, "lip_found": lip,
           "lip_on_way": float(scene.lip_errors(*scene.place(way)).mean()), "lip_sigma": lip_sigma,
           "volume_sigma": survey.sigma_m3}
    results = {"fused": after, "kalman": kalman.heights(), "mean": mean.heights()}
    spread = {"fused": sigma, "kalman": kalman.sigmas()}
    area = COLUMN**2
    for kind in (*KINDS, "trench"):
        mask = kinds[kind] & hit
        out[f"{kind}_columns"] = int(mask.sum())
        error = (before - truth)[mask]
        out[f"{kind}_before_mm2"] = 1e6 * float(np.sum(error**2))
        out[f"{kind}_before_m3"] = area * float(error.sum())
        for which, heights in results.items():
            error = (np.where(np.isfinite(heights), heights, before) - truth)[mask]
            out[f"{kind}_{which}_mm2"] = 1e6 * float(np.sum(error**2))
            out[f"{kind}_{which}_m3"] = area * float(error.sum())
            if which in spread:
                # Columns without a sigma count as errors of their own size: they claim nothing.
                share = np.square(error / spread[which][mask])
                out[f"{kind}_{which}_nees"] = float(np.nansum(share))
                out[f"{kind}_{which}_claims"] = int(np.isfinite(share).sum())
    out["seen_m3"] = area * float((after - truth)[hit].sum())
    # Of the trench as a whole a part is hidden, and nothing is left out.
    whole = kinds["trench"]
    out["whole_before_m3"], out["whole_m3"] = (area * float((z - truth)[whole].sum())
                                               for z in (before, after))
    s, t = scene.half + 0.1, 1.0   # as kinds_of() has it
    corners = np.transpose(scene.place(*np.array([(-s, -t), (s, -t), (s, t), (-s, t)]).T))
    out["whole_sigma_m3"] = fused.volume(corners, sigma=True).sigma_m3
    if hard:
        for which, noise in (("plain", {"flying": False, "dust": False}),
                             ("hard", {"mirrored": True, "body": True})):
            other = site.clone()
            surveyed(soilvdb, scene, other, rig, (*noise_of, 2), (), frames, **noise)
            error = (columns(soilvdb, other) - truth)[kinds["trench"] & hit]
            out[f"{which}_m3"] = area * float(error.sum())
    return out


def moving(task):
    """Figures of one scene about which a sensor moves, whose pose errs in each frame: with the poses
    that are told, the true ones, and the told ones fitted."""
    seed, name = task
    import soilvdb

    scene, rig = Scene(seed), RIGS[name](True)
    rng = np.random.default_rng((seed, 7))
    moves = rng.uniform(*MOVES[0]), rng.uniform(*MOVES[1])
    dug = scene.predicted(soilvdb, PROFILE, rig)
    frames, known = [], []
    for k in range(FRAMES):
        way = turned([0, 0, rng.uniform(-math.pi, math.pi)])
        there = dataclasses.replace(rig, turn=way @ rig.turn, position=np.array(
            [*scene.middle, rig.position[2]]) - way @ [AWAY, 0, 0])
        shift, turn = (sigma * rng.standard_normal(3) for sigma in moves)
        frames.append(Frames(scene, there, (seed, k), (shift, turn)))
        known.append({"position": there.position + shift, "turn": turned(turn) @ there.turn})
    truth, before = columns_of(scene.truth), columns(soilvdb, dug)
    hit, kinds = np.any([f.hits() for f in frames], axis=0), kinds_of(scene, truth, before)
    measured = [f.frame() for f in frames]
    out = {"sensor": name}
    for which in ("told", "known", "fitted"):
        site = dug.clone()
        for frame, ranges, pose in zip(frames, measured, known):
            given = {"name": which, **(pose if which == "known" else {})}
            dataclasses.replace(frame.rig, moves=moves if which == "fitted" else (0.0, 0.0),
                                **given).scan(soilvdb, site, ranges)
        survey = site.apply_scans()
        after, sigma = columns(soilvdb, site), sigmas(site)
        for kind in (*KINDS, "trench"):
            mask = kinds[kind] & hit
            error = (after - truth)[mask]
            out[f"{kind}_columns"] = int(mask.sum())
            out[f"{kind}_{which}_mm2"] = 1e6 * float(np.sum(error**2))
            out[f"{kind}_{which}_nees"] = float(np.sum(np.square(error / sigma[mask])))
            out[f"{kind}_{which}_m3"] = COLUMN**2 * float(error.sum())
            out[f"{kind}_before_m3"] = COLUMN**2 * float((before - truth)[mask].sum())
        out[f"seen_{which}_m3"] = COLUMN**2 * float((after - truth)[hit].sum())
        out[f"sigma_{which}"] = survey.sigma_m3
        lip, out[f"lip_sigma_{which}"] = lip_of(survey, "digger", 0)
        out[f"lip_{which}"] = lip - scene.lip_error
    return out


def own_ground(task):
    """Volume that noise-free scans of the engine's own ground change, m3, and whether bits did."""
    seed, quick = task
    import soilvdb

    site = Scene(seed).predicted(soilvdb, PROFILE, camera(quick))
    was, moved = site.ground_hash(), 0.0
    for make in RIGS.values():
        rig = make(quick)
        ranges = site.cast(rig.position, rig.rays.reshape(-1, 3) @ rig.turn.T)
        for _ in range(3):
            rig.scan(soilvdb, site, np.where(np.isfinite(ranges), ranges, np.nan))
        survey = site.apply_scans()
        moved += survey.removed_m3 + survey.added_m3
    return moved, float(site.ground_hash() != was)


def ranges_to_block(eye, ways, low, high, out, ground):
    """Ranges (N) if a box is taken from level ground at 0, or put onto it; exact. ground: ranges to
    the ground as it was."""
    with np.errstate(divide="ignore"):
        a, b = (low - eye) / ways, (high - eye) / ways
    enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    if not out:
        return np.where((enter < leave) & (enter > 0), np.minimum(enter, ground), ground)
    at = eye[:2] - (eye[2] / ways[:, 2])[:, None] * ways[:, :2]
    return np.where(((at > low[:2]) & (at < high[:2])).all(axis=1), leave, ground)


def block(task):
    """Share by which a block of 1 m3, taken out or put down behind the engine's back, is surveyed
    wrong; and the change of the load, m3. Level ground of which a bucket dug a part before."""
    out, quick = task
    import soilvdb

    site = soilvdb.Site(COLUMN, soilvdb.plane(0.0), [soilvdb.Bucket(WIDTH, 0.9, PROFILE)])
    s = np.linspace(0, 1, 41)
    site.update_path(0, positions=np.stack(
        [-4 + 2 * s, -2 + 0 * s, 0.3 - 0.4 * np.minimum(1, 4 * s)], axis=1))
    site.update(0, position=(-1.5, -2, 0.5))
    site.place(0, position=(-3, -2, 3.0))
    load = site.ledger()["bucket_m3"]
    rig = camera(quick)
    rig.position, rig.turn = np.array([0.5, 0.5, 4.0]), np.diag([1.0, -1.0, -1.0])   # looks down
    h = COLUMN / 2   # columns stand on multiples of their width: 20 x 20 of them
    low, high = np.array([-h, -h, 0.0]), np.array([1 - h, 1 - h, 1.0])
    if out:
        low[2], high[2] = -1.0, 0.0
    ways = rig.rays.reshape(-1, 3) @ rig.turn.T
    ranges = ranges_to_block(rig.position, ways, low, high, out, site.cast(rig.position, ways))
    for _ in range(FRAMES):
        rig.scan(soilvdb, site, ranges)
    survey = site.apply_scans()
    net = survey.removed_m3 - survey.added_m3 if out else survey.added_m3 - survey.removed_m3
    return abs(net - 1.0), abs(site.ledger()["bucket_m3"] - load)


def cost(quick):
    """CPU times on one core, ms: the first scan, later ones, apply_scans(); columns that were seen."""
    import soilvdb

    figures = {}
    for name, make in RIGS.items():
        scene, rig = Scene(DEVELOPMENT_SEEDS[0]), make(quick)
        frames = Frames(scene, rig, 1)
        images = [rig.told(soilvdb, frames.frame()) for _ in range(3)]
        first, scans, applies = [], [], []
        for _ in range(2 if quick else 7):
            site = scene.predicted(soilvdb, PROFILE, rig)
            for k in range(FRAMES):
                begin = time.process_time()
                site.scan(**images[k % len(images)])
                (scans if k else first).append(1000 * (time.process_time() - begin))
            begin = time.process_time()
            site.apply_scans()
            applies.append(1000 * (time.process_time() - begin))
        figures[name] = {"first": statistics.median(first), "scan": statistics.median(scans),
                         "apply": statistics.median(applies), "seen": int(frames.hits().sum())}
    return figures


def oracle(quick):
    """Largest difference of ranges by the ray-marcher here and by Site.cast() to the true ground, m,
    and the share of rays that only one of them found."""
    import soilvdb

    scene, rig = Scene(DEVELOPMENT_SEEDS[1]), camera(True)
    truth = soilvdb.raster(scene.truth.astype(np.float32), origin=ORIGIN, cell=CELL)
    site = soilvdb.Site(COLUMN, truth, [soilvdb.Bucket(1.0, 1.0)])
    ways = rig.rays.reshape(-1, 3) @ rig.turn.T
    ours, theirs = cast(scene.truth, rig.position, ways), site.cast(rig.position, ways)
    both = np.isfinite(ours) & np.isfinite(theirs)
    return (float(np.quantile(np.abs(ours[both] - theirs[both]), 0.999)),
            float((np.isfinite(ours) != np.isfinite(theirs)).mean()))


def one_core(counter):
    """Each process has a core of its own, before the engine counts them."""
    with counter.get_lock():
        mine = counter.value
        counter.value += 1
    cores = sorted(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {cores[mine % len(cores)]})


def root(draws, key):
    """Root of the mean square of a figure over draws."""
    return math.sqrt(sum(d[key] ** 2 for d in draws) / len(draws))


def rows_of(draws, name):
    """Rows of one sensor."""
    d = [each for each in draws if each["sensor"] == name]
    nees = {(kind, which): sum(x[f"{kind}_{which}_nees"] for x in d)
            / max(1, sum(x[f"{kind}_{which}_claims"] for x in d))
            for kind in KINDS for which in ("fused", "kalman")}
    volume = {which: root(d, f"trench_{which}_m3") for which in ("before", *MAPS)}
    height = {(kind, which): math.sqrt(sum(x[f"{kind}_{which}_mm2"] for x in d)
                                       / max(1, sum(x[f"{kind}_columns"] for x in d)))
              for kind in (*KINDS, "trench") for which in ("before", *MAPS)}
    off = math.sqrt(sum((x["lip_found"] - x["lip"]) ** 2 for x in d) / len(d))
    on_way = math.sqrt(sum((x["lip_found"] - x["lip_on_way"]) ** 2 for x in d) / len(d))
    claimed = root(d, "lip_sigma")
    hard = [x for x in d if "hard_m3" in x]
    rows = [(f"{name}: trench's volume, prediction", volume["before"], "m3", ""),
            (f"{name}: the same after {FRAMES} frames", volume["fused"], "m3", ""),
            (f"{name}: their ratio", volume["fused"] / volume["before"], "", "<= 0.25"),
            (f"{name}: natural ground, prediction", height["natural", "before"], "mm", ""),
            (f"{name}: after over before", height["natural", "fused"] / height["natural", "before"], "",
             "<= 1.0"),
            (f"{name}: trench's heights, after over before",
             height["trench", "fused"] / height["trench", "before"], "", ""),
            (f"{name}: heap's heights, after over before",
             height["heap", "fused"] / height["heap", "before"], "", ""),
            (f"{name}: lip error with its drift, mean of the trench", 1000 * on_way, "mm", ""),
            (f"{name}: lip error, prior {1000 * LIP:g} mm", 1000 * off, "mm", "<= 10"),
            (f"{name}: lip's sigma as claimed over it", claimed / max(off, 1e-12), "", "0.8 .. 1.3"),
            (f"{name}: NEES, natural ground", nees["natural", "fused"], "", "0.6 .. 1.2"),
            (f"{name}: NEES, dug floor", nees["floor", "fused"], "", "0.6 .. 1.5"),
            (f"{name}: NEES within {NEAR} columns of steps, slumps", nees["near", "fused"], "", "<= 3"),
            (f"{name}: NEES, heap", nees["heap", "fused"], "", ""),
            (f"{name}: volume of all columns that were seen, error", root(d, "seen_m3"), "m3", ""),
            (f"{name}: sigma as claimed over it",
             root(d, "volume_sigma") / max(root(d, "seen_m3"), 1e-12), "", ""),
            (f"{name}: volume of the trench with its hidden part, after over before",
             root(d, "whole_m3") / root(d, "whole_before_m3"), "", ""),
            (f"{name}: the same, sigma as claimed over its error",
             root(d, "whole_sigma_m3") / max(root(d, "whole_m3"), 1e-12), "", "0.8 .. 1.3"),
            (f"{name}: volume, bucket in view, dust, flying pixels, mirrored, over none of these",
             root(hard, "hard_m3") / max(root(hard, "plain_m3"), 1e-12), "", "<= 1.3")]
    for which, label in (("kalman", "Kalman per cell"), ("mean", "mean per cell")):
        rows += [(f"{name}: {label}, trench's volume over prediction's",
                  volume[which] / volume["before"], "", ""),
                 (f"{name}: {label}, natural ground, after over before",
                  height["natural", which] / height["natural", "before"], "", ""),
                 (f"{name}: fused over {label}, trench's volume", volume["fused"] / volume[which], "",
                  "<= 1.0"),
                 (f"{name}: the same, natural ground",
                  height["natural", "fused"] / height["natural", which], "", "<= 1.0"),
                 (f"{name}: the same, trench's heights",
                  height["trench", "fused"] / height["trench", which], "", "<= 1.0"),
                 (f"{name}: the same, heap's heights",
                  height["heap", "fused"] / height["heap", which], "", "<= 1.0")]
    rows += [(f"{name}: Kalman per cell, NEES {what}", nees[kind, "kalman"], "", "")
             for kind, what in (("natural", "natural ground"), ("floor", "dug floor"))]
    return rows


def rows_of_moving(draws, name):
    """Rows of one sensor that moves."""
    d = [each for each in draws if each["sensor"] == name]
    volume = {which: root(d, f"trench_{which}_m3") for which in ("told", "known", "fitted")}
    nees = {(kind, which): sum(x[f"{kind}_{which}_nees"] for x in d)
            / max(1, sum(x[f"{kind}_columns"] for x in d))
            for kind in ("natural", "floor") for which in ("told", "fitted")}
    return [(f"moving {name}: trench's volume, poses fitted over as told",
             volume["fitted"] / volume["told"], "", "<= 0.5"),
            (f"moving {name}: the same over true poses", volume["fitted"] / volume["known"], "",
             "<= 1.1"),
            (f"moving {name}: NEES, natural ground", nees["natural", "fitted"], "", "0.6 .. 1.2"),
            (f"moving {name}: NEES, dug floor, poses as told", nees["floor", "told"], "", ""),
            (f"moving {name}: the same, fitted", nees["floor", "fitted"], "", "")]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--development", action="store_true", help="seeds to work with")
    parser.add_argument("--draws", type=int)
    parser.add_argument("--cores", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--out", type=Path, default=Path("out/bench/sensing"))
    options = parser.parse_args()
    quick = options.quick
    seeds = DEVELOPMENT_SEEDS if quick or options.development else HELD_OUT_SEEDS
    count = options.draws or (3 if quick else len(seeds))
    spawn = multiprocessing.get_context("spawn")

    def pool(cores):
        return ProcessPoolExecutor(cores, mp_context=spawn, initializer=one_core,
                                   initargs=(spawn.Value("i", 0),))

    with pool(1) as alone:   # nothing runs beside it
        costs = alone.submit(cost, quick).result()
    tasks = [(seed, name, quick, quick or k % 4 == 0)
             for k, seed in enumerate(seeds[:count]) for name in RIGS]
    with pool(options.cores) as workers:
        own = workers.map(own_ground, [(seed, quick) for seed in seeds[:2 if quick else 10]])
        taken, put = workers.map(block, [(True, quick), (False, quick)])
        checked = workers.submit(oracle, quick).result()
        draws = list(workers.map(draw, tasks))
        moved_draws = list(workers.map(moving, [(seed, name) for seed in seeds[:count] for name in RIGS]))
        moved, bits = (sum(each) for each in zip(*own))
    options.out.mkdir(parents=True, exist_ok=True)
    with open(options.out / "draws.csv", "w", newline="", encoding="utf-8") as file:
        keys = dict.fromkeys(key for each in draws for key in each)
        writer = csv.DictWriter(file, keys)
        writer.writeheader()
        writer.writerows(draws)
    rows = [("rays here against Site.cast(), 99.9 % of them within", 1000 * checked[0], "mm", "<= 0.1"),
            ("rays that only one of them found", 100 * checked[1], "%", "<= 0.1"),
            ("Kalman per cell on level ground, NEES without its gate", check_kalman(np.inf), "",
             "0.95 .. 1.05"),
            ("the same with its gate", check_kalman(GATE), "", "")]
    for name in RIGS:
        rows += rows_of(draws, name) + rows_of_moving(moved_draws, name)
    rows += [("noise-free scans of own ground: changed volume", moved, "m3", "<= 0"),
             ("the same: sites whose bits changed", bits, "", "<= 0"),
             ("a block of 1 m3 taken out, surveyed wrong by", 100 * taken[0], "%", "<= 0.5"),
             ("a block of 1 m3 put down, surveyed wrong by", 100 * put[0], "%", "<= 0.5"),
             ("the load's change by them", taken[1] + put[1], "m3", "<= 0")]
    for name, goals in (("camera", ("<= 10", "<= 20")), ("lidar", ("", ""))):
        rows += [(f"{name}: a scan, one core", costs[name]["scan"], "ms", goals[0]),
                 (f"{name}: the first scan", costs[name]["first"], "ms", ""),
                 (f"{name}: apply_scans()", costs[name]["apply"], "ms", goals[1]),
                 (f"{name}: columns that were seen", costs[name]["seen"], "", "")]
    print(f"{count} draws of the {'development' if seeds is DEVELOPMENT_SEEDS else 'held-out'} seeds")
    report(rows, options.out)


if __name__ == "__main__":
    main()
