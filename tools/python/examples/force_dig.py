# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A dig by force: the bucket drags towards a depth, but gives way where the soil resists too much.
    python3 force_dig.py [LIMIT_KN] [CSV]
"""

import csv
import math
import sys

import numpy as np

import soilvdb

RATE_HZ = 100.0
SPEED_M_S = 0.6
DEPTH_M = 0.35  # below the ground ahead, where the force allows it
TOO_LOW = ("ground ends ahead", "no failure plane", "rolled over", "blade below ground")
PROFILE = [(0, 0), (-0.5, 0.25), (-0.8, 0.5), (-0.6, 0.9), (0, 0.9)]
ROTATION = (0.0, math.sin(0.1), 0.0, math.cos(0.1))  # the mouth looks down by 0.2 rad


def dig(site: soilvdb.Site, limit_n: float) -> list[tuple[float, float, float, float, float]]:
    """Rows of x, ground ahead, lip, depth of the lip (m) and horizontal force (N)."""
    rows: list[tuple[float, float, float, float, float]] = []
    x, lip, rise = -2.5, 0.5, 0.0
    while x < 2.5:
        x, lip = x + SPEED_M_S / RATE_HZ, lip + rise / RATE_HZ
        site.update(0, position=(x, 0.0, lip), rotation=ROTATION)
        resistance = site.resistance(0)
        if any(why in resistance.limited for why in TOO_LOW):
            raise SystemExit(f"at x = {x:.2f} m the force is too low: {resistance.limited}")
        force = -float(resistance.world.force[0])
        # Takes some microseconds after an update: see the table in tools/guide/python.md.
        ground = float(site.heights([(x + 0.3, 0.0)])[0])
        rows.append((x, ground, lip, resistance.depth_m, force))
        # Down towards the depth within 0.5 s; up by what the force is too much; without jerks.
        wanted = max((ground - DEPTH_M - lip) / 0.5, -0.3) + 2.0 * max(0.0, force / limit_n - 0.7)
        rise += 0.1 * (float(np.clip(wanted, -0.3, 0.3)) - rise)
    return rows


def main() -> None:
    limit_n = 1000 * float(sys.argv[1]) if len(sys.argv) > 1 else 12e3
    x = np.linspace(-6, 6, 61)  # across a hill, where the same depth takes more force
    hill = soilvdb.raster(np.tile(0.25 * np.exp(-2 * x**2), (61, 1)), origin=(-6, -6), cell=0.2)
    loam = soilvdb.Soil(0.61, 0.25, density=1800, cohesion=5e3, tool_friction=0.35)
    bucket = soilvdb.Bucket(width=1.2, height=0.9, profile=PROFILE, edge=0.01)
    site = soilvdb.Site(0.05, hill, [bucket], soil=loam)
    rows = dig(site, limit_n)
    over_n = np.array(rows)[:, 4] - limit_n
    print(f"largest force {(limit_n + over_n.max()) / 1000:.1f} kN, over a limit of {limit_n / 1000:.0f} kN "
          f"for {(over_n > 0).sum() / RATE_HZ:.2f} s; load {site.ledger(0)['bucket_m3']:.2f} m3")
    if len(sys.argv) > 2:
        with open(sys.argv[2], "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([("x_m", "ground_m", "lip_m", "depth_m", "force_n"), *rows])


if __name__ == "__main__":
    main()
