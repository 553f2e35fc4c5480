# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios of which it is known in closed form how well their loads are known. Also for the bench.

Volumes of differences of terrains: Anderson 2019, doi:10.1002/esp.4551; the spherical variogram's
factor, pi / 5, is that of Rolstad et al. 2009.
"""

import dataclasses
import math

import numpy as np

import soilvdb
from soilvdb import noise as noises
from soilvdb.fleet.study import Scene, Study
from soilvdb.fleet.uncertainty import spread

WIDTH, LENGTH, DEPTH = 1.2, 2.5, 0.25


@dataclasses.dataclass
class Case:
    """A sigma that was found and the one that is right."""

    found: float
    right: float
    draws: int

    @property
    def ratio(self):
        return self.found / self.right

    def within(self, relative):
        """Is it, with three standard errors of a sigma of so many draws?"""
        return abs(self.ratio - 1) <= relative + 3 / math.sqrt(2 * self.draws)


def write_pass(folder, *, width=WIDTH, length=LENGTH, depths=(DEPTH,), rows=26, voxel=0.05,
               terrain="{plane: {z: 0.0}}", dump=False, name="pass"):
    """Flat passes from x = 0 one after the other, each at its depth, begun in the ground."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = ["time,x,y,z,pitch"]
    for i, depth in enumerate(depths):
        for k in range(rows):
            s = k / (rows - 1)
            lines.append(f"{20 * i + 5 * s},{length * s},0,{-depth},0")
        if dump:  # up, tipped, and back over where it began
            lines += [f"{20 * i + 8},{length},0,1.5,0", f"{20 * i + 10},{length},0,1.5,1.2",
                      f"{20 * i + 12},{length},0,1.5,0", f"{20 * i + 16},0,0,1.5,0"]
    (folder / f"{name}.csv").write_text("\n".join(lines) + "\n")
    bucket = f"{{width: {width}, height: 0.9{', dump_angle: 0.9' if dump else ''}}}"
    (folder / f"{name}.yaml").write_text(
        f"soilvdb: 1\nvoxel_size: {voxel}\nterrain: {terrain}\nmachines:\n"
        f"  - {{name: digger, bucket: {bucket}, motion: {name}.csv}}\n")
    return folder / f"{name}.yaml"


def scene(scenario, noise, seed=1):
    return Scene(Study(str(scenario), noises.of(noise), seed))


def cuts(scenario, noise, draws, seed=1):
    """Of draws, m3."""
    one = scene(scenario, noise, seed)
    return np.array([one.dig(one.study.noise.draw(seed, i)).cut_m3["digger"][-1]
                     for i in range(draws)])


def flat_pass(folder, sigma, draws):
    """A height that is off by a constant."""
    found = cuts(write_pass(folder), {"position": {"bias": [0, 0, sigma]}}, draws)
    return Case(found.std(ddof=1), WIDTH * LENGTH * sigma, draws)


def uncorrelated_terrain(folder, sigma, draws, cell=0.1):
    """Heights that err each for itself: sigma * cell * sqrt(area)."""
    noise = {"terrain": {"white": sigma, "cell": cell}}
    found = cuts(write_pass(folder, width=2.4, length=5.0, rows=6), noise, draws)
    return Case(found.std(ddof=1), sigma * cell * math.sqrt(2.4 * 5.0), draws)


def correlated_terrain(folder, sigma, draws, length=0.5):
    """Heights that err together over a range: sigma * area * sqrt(pi / 5 * range^2 / area)."""
    noise = {"terrain": {"correlated": {"sigma": sigma, "length": length}}}
    area = 4.0 * 8.0
    found = cuts(write_pass(folder, width=4.0, length=8.0, rows=6, voxel=0.1), noise, draws)
    return Case(found.std(ddof=1), sigma * length * math.sqrt(math.pi / 5 * area), draws)


def systematic_terrain(folder, sigma, draws):
    """Heights that all err alike: sigma * area."""
    found = cuts(write_pass(folder), {"terrain": {"bias": sigma}}, draws)
    return Case(found.std(ddof=1), sigma * WIDTH * LENGTH, draws)


def drifting_height(folder, sigma, draws, tau=4.0):
    """The mean over a pass of T = 5 s of a Gauss-Markov process: its variance is
    2 tau^2 / T^2 (T / tau - 1 + exp(-T / tau))."""
    noise = {"position": {"drift": {"sigma": [0, 0, sigma], "tau": tau}}}
    found = cuts(write_pass(folder, rows=51), noise, draws)
    t = 5 / tau
    return Case(found.std(ddof=1),
                WIDTH * LENGTH * sigma * math.sqrt(2 * (t - 1 + math.exp(-t))) / t, draws)


def white_height(folder, sigma, draws, rows=51):
    """A height that errs in each row for itself, straight between: trapezoids."""
    found = cuts(write_pass(folder, rows=rows), {"position": {"white": [0, 0, sigma]}}, draws)
    steps = rows - 1
    return Case(found.std(ddof=1), WIDTH * LENGTH * sigma * math.sqrt(steps - 0.5) / steps, draws)


def wide_bucket(folder, sigma, draws):
    """A width that is known to a sigma: sigma * length * depth."""
    found = cuts(write_pass(folder), {"bucket": {"width": sigma}}, draws)
    return Case(found.std(ddof=1), sigma * LENGTH * DEPTH, draws)


def repeated_passes(folder, sigma, draws, passes=4):
    """@return sigma of each pass's load over width * length * sigma, of passes each deeper by the
    same"""
    depths = [DEPTH * (i + 1) / 2 for i in range(passes)]
    one = scene(write_pass(folder, depths=depths, dump=True), {"position": {"bias": sigma}})
    ends = [np.searchsorted(one.motions["digger"]["times"], 20 * i + 5) for i in range(passes)]
    loads = np.array([one.dig(one.study.noise.draw(1, i)).load_m3["digger"][ends]
                      for i in range(draws)])
    return loads.std(axis=0, ddof=1) / (WIDTH * LENGTH * sigma)


NOISE = {"position": {"bias": 0.01, "drift": {"sigma": 0.01, "tau": 30}, "white": 0.002},
         "rotation": {"bias": 0.005}, "bucket": {"width": 0.01},
         "terrain": {"bias": 0.005, "correlated": {"sigma": 0.01, "length": 1.0}}}


def covered(folder, scenarios, draws, first=0):
    """Of digs that are known, recorded with errors: @return how many of the true loads, 0 to 1, are
    between the percentiles 5 and 95 of what is drawn from the record."""
    folder.mkdir(parents=True, exist_ok=True)
    hits = 0
    for i in range(first, first + scenarios):
        chance = np.random.default_rng((20, i))
        true = write_true(folder / f"true{i}", chance)
        truth = soilvdb.Site.open(true)
        motion = soilvdb.motions(true)["digger"]
        load = truth.update_path("digger", **motion)["bucket_m3"][-1]
        recorded = write_recorded(folder / f"recorded{i}", true, motion, chance)
        one = scene(recorded, NOISE, seed=i)
        drawn = spread([one.dig(one.study.noise.draw(i, k)).load_m3["digger"][-1]
                        for k in range(draws)])
        hits += drawn["p05"] <= load <= drawn["p95"]
    return hits / scenarios


def write_true(folder, chance):
    """Two passes at random on sloping ground, as a raster."""
    folder.mkdir()
    n, cell = 101, 0.25
    at = -12.5 + cell * np.arange(n)
    slope = chance.uniform(-0.1, 0.1, 2)
    soilvdb.write_raster(folder / "ground.tif", slope[0] * at[None, :] + slope[1] * at[:, None],
                         (-12.5, -12.5), (cell, cell))
    depth = chance.uniform(0.15, 0.35)
    rows = []
    for i in range(2):
        length, heading = chance.uniform(1.5, 3), chance.uniform(-0.2, 0.2)
        for k in range(26):
            s = k / 25
            x, y = length * s * math.cos(heading), length * s * math.sin(heading)
            z = slope[0] * x + slope[1] * y - depth * (i + 1) / 1.5 * math.sin(math.pi * s)**0.5
            rows.append((30 * i + 5 * s, x, y, z, 0, 0, heading))
        rows += [(30 * i + 8, x, y, 1.5, 0, 0, heading), (30 * i + 16, 0, 0, 1.5, 0, 0, 0)]
    width = chance.uniform(0.8, 1.4)
    write_dig(folder, rows, width, "time,x,y,z,roll,pitch,yaw")
    return folder / "dig.yaml"


def write_dig(folder, rows, width, header):
    (folder / "dig.csv").write_text("\n".join([header, *(",".join(map(repr, map(float, row)))
                                                         for row in rows)]) + "\n")
    (folder / "dig.yaml").write_text(
        "soilvdb: 1\nvoxel_size: 0.05\nterrain: {raster: ground.tif}\nmachines:\n"
        f"  - {{name: digger, bucket: {{width: {width!r}, height: 0.9}}, motion: dig.csv}}\n")


def write_recorded(folder, true, motion, chance):
    """The same dig as its sensors, its survey and its drawing have it: errors made here, by textbook
    formulas, not by what is tested."""
    folder.mkdir()
    times = motion["times"]
    drift = np.empty((len(times), 3))
    drift[0] = chance.normal(size=3)
    for k in range(1, len(times)):
        kept = math.exp(-(times[k] - times[k - 1]) / 30)
        drift[k] = kept * drift[k - 1] + math.sqrt(1 - kept**2) * chance.normal(size=3)
    at = (motion["positions"] + chance.normal(0, 0.01, 3) + 0.01 * drift
          + chance.normal(0, 0.002, drift.shape))
    turn = chance.normal(0, 0.005, 3) / 2  # small: a quaternion's first three, twice
    x, y, z, w = motion["rotations"].T
    a, b, c = turn
    q = np.stack([x + w * a + y * c - z * b, y + w * b - x * c + z * a, z + w * c + x * b - y * a,
                  w - x * a - y * b - z * c], axis=1)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    heights, first, spacing, _ = soilvdb.read_raster(true.parent / "ground.tif")
    count = heights.shape[0]
    places = np.stack(np.meshgrid(*[spacing[0] * np.arange(count)] * 2), -1).reshape(-1, 2)
    near = np.abs(places - 12.5).max(axis=1) < 5  # what is dug; the rest errs by the bias alone
    apart = np.linalg.norm(places[near][:, None] - places[near][None], axis=-1)
    h = np.minimum(1, apart / 1.0)
    covariance = 1 - 1.5 * h + 0.5 * h**3
    error = np.zeros(count * count)
    if not hasattr(write_recorded, "root"):
        write_recorded.root = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(covariance)))
    error[near] = 0.01 * (write_recorded.root @ chance.normal(size=int(near.sum())))
    error += chance.normal(0, 0.005)
    soilvdb.write_raster(folder / "ground.tif", heights + error.reshape(heights.shape), first,
                         spacing)
    width = float(true.read_text().split("width: ")[1].split(",")[0]) + chance.normal(0, 0.01)
    write_dig(folder, np.column_stack([times, at, q]), width, "time,x,y,z,qx,qy,qz,qw")
    return folder / "dig.yaml"
