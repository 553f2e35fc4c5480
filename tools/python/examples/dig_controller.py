# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A dig controller with feedback from soilvdb: it looks at the ground ahead in each step, drags until
the bucket holds the wanted load, goes deeper if the bucket fills too slowly, then curls and lifts.

    python3 dig_controller.py [LOAD_M3]
"""

import sys

import numpy as np

import soilvdb

RATE_HZ = 100.0
SPEED_M_S = 0.8
CELL_M = 0.05
MAP = (32, 32)  # cells along the lip and across it
WIDTH_M = 1.2
CURL_M3 = 0.07  # what lies before the mouth comes in while the bucket curls
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]


def pitch(angle: float) -> tuple[float, float, float, float]:
    """Quaternion (x, y, z, w) of a turn about the lip, rad; positive: the mouth looks down."""
    return (0.0, float(np.sin(angle / 2)), 0.0, float(np.cos(angle / 2)))


def dig(site: soilvdb.Site, wanted_m3: float, begin: tuple[float, float]) -> tuple[float, int]:
    """Fills the bucket from a place on; returns its load once it is lifted, m3, and the updates."""
    (x, y), lip, load, updates = begin, 0.1, 0.0, 1
    site.update(0, position=(x, y, lip), rotation=pitch(0.3))
    view = np.empty(MAP, np.float32)
    before_lip = slice(round(MAP[0] / 2 - WIDTH_M / 2 / CELL_M), round(MAP[0] / 2 + WIDTH_M / 2 / CELL_M))
    ahead = round(MAP[1] / 2 + 0.3 / CELL_M)
    while load < wanted_m3 - CURL_M3 and x < begin[0] + 6.0:
        # Takes some tens of microseconds: see the table in tools/guide/python.md.
        site.height_map(machine=0, shape=MAP, cell=CELL_M, out=view)
        ground = float(view[before_lip, ahead].mean())
        # The missing load should come within the next 1.5 m.
        depth = np.clip((wanted_m3 - load) / (WIDTH_M * 1.5), 0.1, 0.4)
        x += SPEED_M_S / RATE_HZ
        lip += np.clip(ground - depth - lip, -0.5 / RATE_HZ, 0.5 / RATE_HZ)
        # Curls while it fills, so that the load stays.
        update = site.update(0, position=(x, y, lip), rotation=pitch(0.3 - 1.4 * load / wanted_m3))
        load, updates = update.bucket_m3, updates + 1
    curled = 0.3 - 1.4 * load / wanted_m3
    lifting = np.linspace(0, 1, int(1.5 * RATE_HZ))
    for s in lifting:
        update = site.update(0, position=(x, y, lip + 2.0 * s),
                             rotation=pitch(curled + (-1.5 - curled) * min(2 * s, 1.0)))
    return update.bucket_m3, updates + len(lifting)


def main() -> None:
    wanted_m3 = float(sys.argv[1]) if len(sys.argv) > 1 else 0.6
    bucket = soilvdb.Bucket(width=WIDTH_M, height=0.9, profile=PROFILE)
    loam = soilvdb.Soil(repose_angle=0.61, swell=0.25)
    with soilvdb.Site(0.05, soilvdb.plane(0.0), [bucket], soil=loam) as site:
        for stroke in range(3):
            load_m3, updates = dig(site, wanted_m3, (0.0, 1.4 * stroke))
            print(f"stroke {stroke + 1}: {load_m3:.3f} m3 of {wanted_m3:.3f} wanted, "
                  f"{updates} updates")
            site.update(0, position=(0.0, -4.0, 2.5), rotation=pitch(1.6))  # tips beside the trench


if __name__ == "__main__":
    main()
