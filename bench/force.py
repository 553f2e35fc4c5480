# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The force of the soil on a bucket, from Python: its error against a search over failure planes on
exact geometry, its laws, what it costs, and how well it tells the soil."""

from __future__ import annotations

import math
import statistics
import time

import numpy as np

from goals import PROFILE, measured, report

G, DEG = 9.80665, math.pi / 180
WIDTH, DEPTH = 1.2, 0.3
# rake, friction, tool friction (degrees), cohesion (Pa), slope of the ground (degrees)
CASES = [(90, 30, 0, 0, 0), (90, 0, 0, 20e3, 0), (45, 35, 70 / 3, 0, 0), (60, 30, 20, 10e3, 0),
         (60, 30, 20, 10e3, 15), (60, 30, 20, 10e3, -15), (30, 30, 20, 10e3, 0)]


def lean(rake):
    half = (rake - 90) * DEG / 2
    return (0.0, math.sin(half), 0.0, math.cos(half))


def in_world(rake, force):
    a = (rake - 90) * DEG
    return np.array([math.cos(a) * force[0] + math.sin(a) * force[2], force[1],
                     -math.sin(a) * force[0] + math.cos(a) * force[2]])


def soil_of(soilvdb, case):
    _, friction, tool, cohesion, _ = case
    return soilvdb.Soil(density=18e3 / G, cohesion=cohesion, friction_angle=friction * DEG,
                        tool_friction=tool * DEG)


def exact(case, x, z):
    """Force (ahead, up) on the bucket per metre: a search over 20 000 planes in ground that is
    straight between points (x, z), with the lip at (0, 0). Shares nothing with the engine."""
    rake, friction, tool, cohesion, _ = (v if i == 3 else v * DEG for i, v in enumerate(case))
    back = np.linspace(0, 3, 300001)[1:]
    over = np.interp(-back * math.cos(rake), x, z) - back * math.sin(rake)
    length = back[np.argmax(over <= 0)]
    end = np.array([-length * math.cos(rake), length * math.sin(rake)])
    least = math.inf
    out = np.arange(0, 8, 1e-3)
    heights = np.interp(out, x, z)
    inner = out[(out > end[0])]
    below = np.concatenate([[0], np.cumsum(np.diff(inner) * (np.interp(inner[1:], x, z)
                                                             + np.interp(inner[:-1], x, z)) / 2)])
    before = 0.0
    if end[0] < 0:
        steps = np.linspace(end[0], 0, 2001)
        before = float(np.trapz(np.interp(steps, x, z), steps))
    for beta in np.linspace(0.5 * DEG, min(math.pi - rake - friction - tool, math.pi / 2) - 1e-4,
                            20000):
        lower = heights <= out * math.tan(beta)
        lower[0] = False
        at = int(np.argmax(lower))
        if at == 0:
            continue
        a = heights[at - 1] - out[at - 1] * math.tan(beta)
        b = heights[at] - out[at] * math.tan(beta)
        u = out[at - 1] + 1e-3 * a / (a - b)
        w = u * math.tan(beta)
        area = before + float(np.interp(u, inner, below)) - u * w / 2 + end[0] * end[1] / 2
        p = ((18e3 * area * math.sin(beta + friction) + cohesion * math.hypot(u, w) * math.cos(friction))
             / math.sin(rake + beta + tool + friction))
        least = min(least, p)
    return np.array([-least * math.sin(rake + tool), -least * math.cos(rake + tool)])


def site_of(soilvdb, voxel, rake, terrain):
    site = soilvdb.Site(voxel, terrain, [soilvdb.Bucket(WIDTH, 1.0)])
    for x in (-0.6, -0.3, 0.0):
        site.update(0, position=(x, 0, 0), rotation=lean(rake))
    return site


def errors(soilvdb, voxel, count, seed):
    """Largest error of the cases on planes, and on random ground, shares of the force."""
    planes, rough = [], []
    rng = np.random.default_rng(seed)
    x = np.arange(-3, 8.01, 0.01)
    for case in CASES:
        terrain = soilvdb.plane(DEPTH, (math.tan(case[4] * DEG), 0))
        wanted = exact(case, x, DEPTH + x * math.tan(case[4] * DEG))
        cut = site_of(soilvdb, voxel, case[0], terrain).resistance(
            soil=soil_of(soilvdb, case), crescents=False).parts["cut"].force
        given = in_world(case[0], cut)[[0, 2]] / WIDTH
        planes.append(np.linalg.norm(given - wanted) / np.linalg.norm(wanted))
    posts = np.arange(-50, 51) * 0.2
    for _ in range(count):
        case = (rng.uniform(25, 75), rng.uniform(15, 40), rng.uniform(5, 15), rng.uniform(0, 2e4), 0)
        ground = DEPTH + rng.uniform(-0.06, 0.12, len(posts)) + np.maximum(
            0, rng.uniform(0, 0.4) - 0.6 * np.abs(posts - rng.uniform(0.4, 2)))
        terrain = soilvdb.raster(np.tile(ground.astype(np.float32), (101, 1)), origin=(-10, -10),
                                 cell=0.2)
        r = site_of(soilvdb, voxel, case[0], terrain).resistance(soil=soil_of(soilvdb, case),
                                                                 crescents=False)
        if r.limited:
            continue
        wanted = exact(case, posts, ground.astype(np.float32).astype(float))
        given = in_world(case[0], r.parts["cut"].force)[[0, 2]] / WIDTH
        rough.append(np.linalg.norm(given - wanted) / np.linalg.norm(wanted))
    return {"planes": 100 * max(planes), "rough": 100 * max(rough),
            "rough median": 100 * statistics.median(rough)}


def laws(soilvdb, quick):
    """Spread over numbers of updates and yaws; jumps and work over a drag; derivatives."""
    loam = soil_of(soilvdb, CASES[3])
    bucket = soilvdb.Bucket(WIDTH, 0.9, PROFILE)

    def dug(updates, yaw):
        site = soilvdb.Site(0.05, soilvdb.plane(0.0, (0.1 * math.cos(yaw), 0.1 * math.sin(yaw))),
                            [bucket])
        way = np.array([math.cos(yaw), math.sin(yaw), 0])
        q = np.array([0, math.sin(0.35), 0, math.cos(0.35)])
        a, b = math.sin(yaw / 2), math.cos(yaw / 2)
        turn = (-a * q[1], b * q[1], a * q[3], b * q[3])
        site.update(0, position=-1.5 * way + [0, 0, 0.5], rotation=turn)
        for s in np.linspace(0, 1, updates):
            site.update(0, position=(s - 0.9) * way + [0, 0, -0.3], rotation=turn)
        return site.resistance(soil=loam).force

    base = dug(20, 0.0)
    size = np.linalg.norm(base)
    updates = max(np.linalg.norm(dug(n, 0.0) - base) for n in ((100,) if quick else (100, 5000)))
    yaws = max(np.linalg.norm(dug(20, yaw) - base) for yaw in (0.3, 0.9, math.pi / 2, 2.2, math.pi))
    site = soilvdb.Site(0.05, soilvdb.plane(DEPTH), [soilvdb.Bucket(WIDTH, 1.0)])
    site.update(0, position=(-1.5, 0, 0), rotation=lean(60))
    forces = []
    for n in range(1, 200 if quick else 2000):
        site.update(0, position=(-1.5 + 0.001 * n, 0, 0), rotation=lean(60))
        forces.append(-in_world(60, site.resistance(soil=loam, crescents=False).parts["cut"].force)[0])
    forces = np.array(forces)
    jump = float(np.abs(np.diff(forces) / forces[1:]).max())
    work = float(abs(forces.mean() / (WIDTH * 10296.96) - 1))
    names = {"density": 1800.0, "cohesion": 9e3, "friction_angle": 0.5, "tool_friction": 0.3,
             "adhesion": 800.0}
    jacobian, worst = site.resistance(soil=soilvdb.Soil(**names)).jacobian, 0.0
    for k, (name, at) in enumerate(names.items()):
        more, less = (site.resistance(soil=soilvdb.Soil(**{**names, name: at * (1 + d)})).force
                      for d in (1e-5, -1e-5))
        by = (more - less) / (2e-5 * at)
        worst = max(worst, float(np.linalg.norm(by - jacobian[:, k]) / np.linalg.norm(by)))
    return {"updates": 100 * updates / size, "yaws": 100 * yaws / size, "jump": 100 * jump,
            "work": 100 * work, "derivatives": worst}


def costs(soilvdb, quick):
    """Median time of a call, us."""
    loam, figures = soil_of(soilvdb, CASES[3]), {}
    for voxel in (0.1, 0.05, 0.025):
        for rake in (45, 85):
            site = site_of(soilvdb, voxel, rake, soilvdb.plane(DEPTH))
            times = []
            for _ in range(50 if quick else 1000):
                begin = time.perf_counter()
                site.resistance(soil=loam)
                times.append(1e6 * (time.perf_counter() - begin))
            figures[f"{voxel:g} at {rake}"] = statistics.median(times)
    site, times = site_of(soilvdb, 0.05, 45, soilvdb.plane(DEPTH)), []
    for n in range(50 if quick else 500):
        site.update(0, position=(0.002 * n, 0, 0), rotation=lean(45))
        begin = time.perf_counter()
        site.resistance(soil=loam)
        times.append(1e6 * (time.perf_counter() - begin))
    figures["after an update"] = statistics.median(times)
    return figures


def errors_of_rows(rng, count, rho):
    """(count, 3), variance 1: an autoregressive process from row to row; rho 0: independent."""
    errors = rng.standard_normal((count, 3))
    for row in range(1, count):
        errors[row] = rho * errors[row - 1] + math.sqrt(1 - rho**2) * errors[row]
    return errors


def identification(soilvdb, quick, rho):
    """Shares of draws whose truth is inside two sigma: cohesion, friction angle; their errors."""
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(WIDTH, 0.9, PROFILE)])
    rng, rows = np.random.default_rng(1), []
    for step in range(205):
        pitch = 0.6 + 0.2 * math.sin(step / 13)
        site.update(0, position=(0.03 * step, 0, -0.35 + 0.25 * math.cos(step / 9)),
                    rotation=(0, math.sin(pitch / 2), 0, math.cos(pitch / 2)))
        rows.append(site.cut_geometry())
    rows = rows[5:]
    truth = soilvdb.Soil(density=1750, cohesion=7e3, friction_angle=0.52, tool_friction=0.35)
    forces = np.array([row.resistance(truth).force for row in rows])
    inside, found = np.zeros(2), []
    draws = 10 if quick else 500
    guess = soilvdb.Soil(density=1750, cohesion=3e3, friction_angle=0.6, tool_friction=0.35)
    noise = 0.05 * np.linalg.norm(forces, axis=1, keepdims=True) / math.sqrt(3)
    for _ in range(draws):
        measured_ = forces + noise * errors_of_rows(rng, len(rows), rho)
        got = soilvdb.identify(rows, measured_, soil=guess)
        inside += [abs(got.cohesion - 7e3) < 2 * got.cohesion_sigma,
                   abs(got.friction_angle - 0.52) < 2 * got.friction_angle_sigma]
        found.append((got.cohesion, got.friction_angle))
    spread = np.std(found, axis=0)
    return {"cohesion": 100 * inside[0] / draws, "friction": 100 * inside[1] / draws,
            "cohesion sigma": float(spread[0]), "friction sigma": float(spread[1])}


def measure(quick):
    import soilvdb

    count = 3 if quick else 30
    figures = {f"{voxel:g}": errors(soilvdb, voxel, count, 7) for voxel in (0.05, 0.025, 0.0125)}
    return figures | {"laws": laws(soilvdb, quick), "costs": costs(soilvdb, quick),
                      "identify": identification(soilvdb, quick, 0.0),
                      "lasting": identification(soilvdb, quick, 0.8)}


def main():
    f, _, out = measured("force", measure)
    rows = []
    for voxel, goal in (("0.05", "<= 0.5"), ("0.025", ""), ("0.0125", "<= 0.1")):
        at = f"{100 * float(voxel):g} cm"
        rows += [(f"largest error on planes, {at}", f[voxel]["planes"], "%", goal),
                 (f"largest error on random ground, {at}", f[voxel]["rough"], "%", goal),
                 (f"its median, {at}", f[voxel]["rough median"], "%", "")]
    laws_, costs_, found = f["laws"], f["costs"], f["identify"]
    rows += [("the same pose by 20 to 5000 updates", laws_["updates"], "%", "<= 0.1"),
             ("any yaw, a bucket in dug ground, 5 cm", laws_["yaws"], "%", "<= 1"),
             ("work of a drag against force times length", laws_["work"], "%", "<= 1"),
             ("largest jump between updates of 1 mm", laws_["jump"], "%", "<= 0.5"),
             ("derivatives against differences", laws_["derivatives"], "", "<= 1e-5")]
    for voxel, goal in (("0.1", 10), ("0.05", 20), ("0.025", 60)):
        at = f"{100 * float(voxel):g} cm"
        rows += [(f"a call, bucket of 1.2 m, rake 45 degrees, {at}", costs_[f"{voxel} at 45"], "us",
                  f"<= {goal}"),
                 (f"the same, rake 85 degrees, {at}", costs_[f"{voxel} at 85"], "us", "")]
    rows += [("the same after an update, rake 45 degrees, 5 cm", costs_["after an update"], "us", ""),
             ("truth inside two sigma of 200 rows with 5 % noise: cohesion", found["cohesion"], "%",
              ">= 92"),
             ("the same: friction angle", found["friction"], "%", ">= 92"),
             ("the same of errors that correlate by 0.8 from row to row: cohesion",
              f["lasting"]["cohesion"], "%", ">= 92"),
             ("the same of these errors: friction angle", f["lasting"]["friction"], "%", ">= 92"),
             ("standard deviation of cohesion (7000 Pa)", found["cohesion sigma"], "Pa", ""),
             ("standard deviation of friction angle (0.52 rad)", found["friction sigma"], "rad", "")]
    report(rows, out)


if __name__ == "__main__":
    main()
