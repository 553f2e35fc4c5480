# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A learning environment with reset() and step() as of Gymnasium's vector environments. It needs no
learning library.

The task: fill the bucket in one stroke. An action moves and turns the lip for a tenth of a second.
An observation is the load, the lip's place and heights of the ground around it. Each episode has
ground of its own slope and soil of its own repose angle. An environment whose episode is over begins
anew in the next step. A step of 64 environments takes some milliseconds, nearly all in the soil.

    python3 dig_env.py
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

import soilvdb

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

STEP_S = 0.1
MOST_STEPS = 60
MAP = (3, 15)  # cells across and along the machine, of 0.2 m
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]


class DigEnv:
    """Actions (num_envs, 3): speed along x in [0, 1] m/s, along z in [-1, 1] m/s, and turn of the
    mouth downwards in [-1, 1] rad/s. Observations (num_envs, 49): load, m3, x and z of the lip, m,
    pitch, rad, and a map of heights, m, row by row: the middle one, at MAP, is under the lip."""

    def __init__(self, num_envs: int, voxel_size: float = 0.1, steepest: float = 0.1,
                 soil: soilvdb.Soil | None = soilvdb.Soil(0.61, 0.25)) -> None:
        bucket = soilvdb.Bucket(width=1.2, height=0.9, profile=PROFILE)
        start = soilvdb.Site(voxel_size, soilvdb.plane(0.0), [bucket], soil=soil)
        self.num_envs = num_envs
        self._sites = soilvdb.VectorSite(start, num_envs)
        self._steepest, self._moves = steepest, soil is not None
        self._lip = np.zeros((num_envs, 3))
        self._pitch = np.zeros(num_envs)
        self._load = np.zeros(num_envs)
        self._steps = np.zeros(num_envs, dtype=int)
        self._over = np.ones(num_envs, dtype=bool)
        self._random = np.random.default_rng()

    def reset(self, *, seed: int | None = None,
              options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        if seed is not None:
            self._random = np.random.default_rng(seed)
        self._begin(np.ones(self.num_envs, dtype=bool))
        self._move()
        return self._observe(), {}

    def step(self, actions: Array) -> tuple[Array, Array, Flags, Flags, dict[str, Any]]:
        """Returns observations, rewards, terminations, truncations and infos."""
        actions = np.clip(actions, -1, 1)
        self._lip[:, 0] += STEP_S * np.maximum(actions[:, 0], 0)
        self._lip[:, 2] = np.clip(self._lip[:, 2] + STEP_S * actions[:, 1], -1.0, 1.0)
        self._pitch = np.clip(self._pitch + STEP_S * actions[:, 2], -1.5, 0.6)
        self._steps += 1
        anew = self._over.copy()
        self._begin(anew)
        before = self._load
        steps = self._move()
        rewards = np.where(anew, 0.0, self._load - before)
        terminated = steps.status != 0  # its state was refused: steps.errors says why
        truncated = self._steps >= MOST_STEPS
        self._over = terminated | truncated
        return self._observe(), rewards, terminated, truncated, {"errors": steps.errors}

    def _begin(self, which: Flags) -> None:
        """Episodes begin on untouched ground."""
        count = int(which.sum())
        if count == 0:
            return
        repose = self._random.uniform(0.5, 0.75, count) if self._moves else None
        self._sites.randomise(which, repose_angle=repose,
                              slope=self._random.uniform(-1, 1, (count, 2)) * self._steepest)
        self._lip[which] = np.stack(
            [self._random.uniform(-0.5, 0.5, count), np.zeros(count), np.full(count, 0.2)], axis=1)
        self._pitch[which], self._load[which], self._steps[which] = 0.3, 0.0, 0
        self._over[which] = False

    def _move(self) -> soilvdb.Steps:
        rotations = np.zeros((self.num_envs, 4))
        rotations[:, 1], rotations[:, 3] = np.sin(self._pitch / 2), np.cos(self._pitch / 2)
        steps = self._sites.step(0, positions=self._lip, rotations=rotations)
        self._load = steps.bucket_m3
        return steps

    def _observe(self) -> Array:
        # Takes some tens of microseconds a site: see the table in tools/guide/python.md.
        maps = self._sites.height_map(machine=0, shape=MAP, cell=0.2)
        return np.column_stack([self._load, self._lip[:, 0], self._lip[:, 2], self._pitch,
                                maps.reshape(self.num_envs, -1)])


def main() -> None:
    env = DigEnv(num_envs=8)
    observations, _ = env.reset(seed=0)
    total = np.zeros(8)
    for _ in range(MOST_STEPS):
        # A simple reference policy: down to 0.3 m below the ground, along, and up.
        z, x = observations[:, 2], observations[:, 1]
        ground = observations[:, 4:].reshape(8, *MAP)[:, 1, 9]  # 0.4 m ahead
        actions = np.stack([np.ones(8), np.clip(3 * (np.where(x < 2.5, ground - 0.3, 1.0) - z), -1, 1),
                            np.where(x < 2.5, 0.0, -1.0)], axis=1)
        observations, rewards, _, _, _ = env.step(actions)
        total += rewards
    print("loads of eight buckets, m3:", np.round(total, 3))


if __name__ == "__main__":
    main()
