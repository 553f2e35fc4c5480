# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Maps of heights that take scans for the ground: a Kalman filter per cell, and the mean per cell.

The filter is that of elevation_mapping, built anew from Fankhauser, Bloesch, Hutter, Probabilistic
Terrain Mapping for Mobile Robots with Uncertain Localization, RA-L 2018. The variance of a point's
height comes from the sensor's noise along the ray and from the uncertain tilt of the sensor. A point
within the Mahalanobis gate is fused; another one adds multi-height noise to its cell's variance.
Left out: the map's motion with a robot, as the sensor stands still, and the visibility clean-up.
"""

from __future__ import annotations

import numpy as np

from sensing_scenes import COLUMN, COLUMNS, FIRST, MOUNT_TILT

# Defaults of the package elevation_mapping, variances in m2.
GATE, MULTI_HEIGHT_NOISE, LEAST_VARIANCE, MOST_VARIANCE = 2.5, 9e-7, 9e-6, 0.01


def cells_of(points):
    """Numbers of points' cells and the points' numbers, of those that lie on the columns scored."""
    rows, cols = COLUMNS
    i = np.round((points[:, 0] - FIRST[0]) / COLUMN).astype(np.int64)
    j = np.round((points[:, 1] - FIRST[1]) / COLUMN).astype(np.int64)
    there = np.flatnonzero((i >= 0) & (j >= 0) & (i < cols) & (j < rows))
    return (j * cols + i)[there], there


class CellMean:
    """The mean height of all points of a cell."""

    def __init__(self):
        self.sum, self.count = (np.zeros(COLUMNS[0] * COLUMNS[1]) for _ in range(2))

    def scan(self, points, ways, ranges, rig):
        cell, there = cells_of(points)
        np.add.at(self.sum, cell, points[there, 2])
        np.add.at(self.count, cell, 1)

    def heights(self):
        with np.errstate(invalid="ignore"):
            return (self.sum / self.count).reshape(COLUMNS)


class CellKalman:
    """Height and variance of each cell, NaN before its first point. As in the package, the gate
    counts only the cell's variance."""

    def __init__(self, gate=GATE):
        self.gate = gate
        self.height, self.variance = (np.full(COLUMNS[0] * COLUMNS[1], np.nan) for _ in range(2))

    def scan(self, points, ways, ranges, rig):
        cell, there = cells_of(points)
        flat = points[there, :2] - rig.position[:2]
        noise = ((rig.sigma(ranges[there]) * ways[there, 2]) ** 2
                 + MOUNT_TILT**2 * (flat**2).sum(axis=1))
        self.fuse(cell, points[there, 2], noise)

    def fuse(self, cell, z, noise):
        """Points one after another; those of different cells at once."""
        order = np.argsort(cell, kind="stable")
        cell, z, noise = cell[order], z[order], noise[order]
        first = np.flatnonzero(np.diff(cell, prepend=-1))
        turn = np.arange(len(cell)) - np.repeat(first, np.diff(first, append=len(cell)))
        by_turn = np.argsort(turn, kind="stable")
        for at in np.split(by_turn, np.cumsum(np.bincount(turn))[:-1]) if len(cell) else ():
            c, p, s = cell[at], z[at], noise[at]
            h, v = self.height[c], self.variance[c]
            new = np.isnan(h)
            fits = np.abs(p - h) < self.gate * np.sqrt(v)
            self.height[c] = np.where(new, p, np.where(fits, (v * p + s * h) / (v + s), h))
            self.variance[c] = np.where(new, s, np.where(fits, s * v / (v + s), v + MULTI_HEIGHT_NOISE))
        wide = self.variance > MOST_VARIANCE     # it knows nothing then, and begins anew
        self.height[wide] = self.variance[wide] = np.nan
        np.maximum(self.variance, LEAST_VARIANCE, out=self.variance)

    def heights(self):
        return self.height.reshape(COLUMNS)

    def sigmas(self):
        return np.sqrt(self.variance).reshape(COLUMNS)


def check_kalman(gate):
    """NEES of the filter on level ground, whose points err as it is told, 12 a cell; 1 if it is right
    and its gate lets all points in."""
    rng, kalman = np.random.default_rng(5), CellKalman(gate)
    for _ in range(3):
        cell = np.repeat(np.arange(20_000), 4)
        sigma = rng.uniform(0.02, 0.05, len(cell))
        kalman.fuse(cell, 0.3 + sigma * rng.standard_normal(len(cell)), sigma**2)
    errors = (kalman.heights() - 0.3) / kalman.sigmas()
    return float(np.nanmean(np.square(errors)))
