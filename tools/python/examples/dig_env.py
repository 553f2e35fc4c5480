# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A learning environment of the usual shape: reset() and step(), many at once.

The task: fill the bucket in one stroke. An action moves and turns the lip for a tenth of a second.
An observation is the load, the lip's place and heights of the ground before and beside it. A reset
clones the untouched site. Both are fast.

    python3 dig_env.py
"""

import numpy as np
import numpy.typing as npt

import soilvdb

Array = npt.NDArray[np.float64]

STEP_S = 0.1
MOST_STEPS = 60
MAP = (3, 15)  # cells across and along the machine, of 0.2 m
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]


class DigEnv:
    """Actions (count, 3) in [-1, 1]: speed along x and z, and curl rate."""

    def __init__(self, count: int, voxel_size: float = 0.1, seed: int = 0) -> None:
        bucket = soilvdb.Bucket(width=1.2, height=0.9, profile=PROFILE)
        self._start = soilvdb.Site(voxel_size, soilvdb.plane(0.0), [bucket])
        self._random = np.random.default_rng(seed)
        self.count = count
        self.reset()

    def reset(self) -> Array:
        self._sites = [self._start.clone() for _ in range(self.count)]
        self._lip = np.stack([self._random.uniform(-0.5, 0.5, self.count), np.zeros(self.count),
                              np.full(self.count, 0.1)], axis=1)
        self._pitch = np.full(self.count, 0.3)
        self._load = np.zeros(self.count)
        self._steps = 0
        self._move()
        return self._observe()

    def step(self, actions: Array) -> tuple[Array, Array, bool]:
        """Returns observations (count, 49), rewards (count,) and whether the episode is over."""
        actions = np.clip(actions, -1, 1)
        self._lip[:, 0] += STEP_S * np.maximum(actions[:, 0], 0)
        self._lip[:, 2] = np.clip(self._lip[:, 2] + STEP_S * actions[:, 1], -1.0, 1.0)
        self._pitch = np.clip(self._pitch + STEP_S * actions[:, 2], -1.5, 0.6)
        before = self._load.copy()
        self._move()
        self._steps += 1
        return self._observe(), self._load - before, self._steps >= MOST_STEPS

    def _move(self) -> None:
        rotations = np.zeros((self.count, 4))
        rotations[:, 1], rotations[:, 3] = np.sin(self._pitch / 2), np.cos(self._pitch / 2)
        updates = soilvdb.update_many(self._sites, 0, positions=self._lip, rotations=rotations)
        self._load = np.array([update.bucket_m3 for update in updates])

    def _observe(self) -> Array:
        maps = soilvdb.height_maps(self._sites, machine=0, shape=MAP, cell=0.2)
        return np.column_stack([self._load, self._lip[:, 0], self._lip[:, 2], self._pitch,
                                maps.reshape(self.count, -1)])


def main() -> None:
    env = DigEnv(count=8)
    observations, done, total = env.reset(), False, np.zeros(8)
    while not done:
        # A simple reference policy: down to 0.3 m, along, and up.
        z, x = observations[:, 2], observations[:, 1]
        actions = np.stack([np.ones(8), np.clip(3 * (np.where(x < 2.5, -0.3, 1.0) - z), -1, 1),
                            np.where(x < 2.5, 0.0, -1.0)], axis=1)
        observations, rewards, done = env.step(actions)
        total += rewards
    print("loads of eight buckets, m3:", np.round(total, 3))


if __name__ == "__main__":
    main()
