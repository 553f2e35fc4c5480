#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Makes zx120_dig.csv: a 12 t excavator digs six bucket loads out of a slope on a terrain model.

    python3 make_zx120_dig.py SHARED

SHARED is the folder with data/dem/dtm.tif (2 m terrain, EPSG:26918) and
data/machine/zx120/zx120.urdf, both from public repositories and not in this one. Python 3 and
gdal_translate, nothing else. Checks joint limits, joint speeds and the loads, and prints the base
pose, the lip and the profile for a scenario.
"""
import csv
import math
import pathlib
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET

HERE = pathlib.Path(__file__).resolve().parent
SHARED = pathlib.Path(sys.argv[1])
RATE = 10  # rows per second

# --- terrain --------------------------------------------------------------------------------------


def read_terrain():
    with tempfile.TemporaryDirectory() as folder:
        asc = pathlib.Path(folder, "dtm.asc")
        subprocess.run(["gdal_translate", "-q", "-of", "AAIGrid",
                        str(SHARED / "data/dem/dtm.tif"), str(asc)], check=True)
        lines = asc.read_text().splitlines()
    head = {}
    while len(lines[0].split()) == 2:
        key, value = lines.pop(0).split()
        head[key.lower()] = float(value)
    return head, [[float(v) for v in line.split()] for line in reversed(lines)]


HEAD, HEIGHTS = read_terrain()


def ground(x, y):
    """Bilinear between cell centres."""
    u = (x - HEAD["xllcorner"]) / HEAD["cellsize"] - 0.5
    v = (y - HEAD["yllcorner"]) / HEAD["cellsize"] - 0.5
    i, j = math.floor(u), math.floor(v)
    u, v = u - i, v - j
    return ((1 - v) * ((1 - u) * HEIGHTS[j][i] + u * HEIGHTS[j][i + 1])
            + v * ((1 - u) * HEIGHTS[j + 1][i] + u * HEIGHTS[j + 1][i + 1]))


# --- machine --------------------------------------------------------------------------------------
# The arm works in a plane that turns with the swing: r outward from the swing axis, z up from
# base_link, SIDE metres to the left. All angles of links are turns about y away from straight up.
# The bucket's attitude there is `a`, the angle by which its mouth looks above the horizontal.

URDF = {j.get("name"): j
        for j in ET.parse(SHARED / "data/machine/zx120/zx120.urdf").getroot().findall("joint")}


def xyz(joint):
    return [float(v) for v in URDF[joint].find("origin").get("xyz").split()]


# The swing's axis is 0 0 2 in the URDF: a direction, which doesn't double the angle.
SIDE = xyz("boom_joint")[1]
FOOT = (xyz("boom_joint")[0], xyz("swing_joint")[2] + xyz("boom_joint")[2])
BOOM, ARM = xyz("arm_joint")[2], xyz("bucket_joint")[2]
LIP = 1.23  # from the bucket's pin along bucket_link's z: the tips of the teeth in the mesh
NAMES = ["swing_joint", "boom_joint", "arm_joint", "bucket_joint"]
LIMITS = [(-math.pi, math.pi)] + [
    tuple(float(URDF[n].find("limit").get(k)) for k in ("lower", "upper")) for n in NAMES[1:]]
SPEEDS = [0.7, 0.4, 0.45, 0.45]  # rad/s; the machine's limit is 0.5 for arm and bucket

WIDTH, HEIGHT = 0.70, 1.10
# The mesh seen from the side, bottom plate to back to upper edge, simplified outward by <= 2 cm.
# The bottom plate lies 38 degrees off the mouth's normal: that is the clearance angle to play with.
PROFILE = [(0, 0), (-0.16, 0.095), (-0.32, 0.245), (-0.68, 0.53), (-0.765, 0.64), (-0.79, 0.78),
           (-0.775, 0.93), (-0.72, 1.02), (-0.60, 1.10), (0, 1.10)]

EAST, NORTH, YAW = 321757.0, 4297525.0, math.radians(20)  # looks up the slope, a little across


def base_pose():
    """Origin, and the axes of base_link: z normal to the ground under the tracks."""
    c, s = math.cos(YAW), math.sin(YAW)

    def slope(dx, dy, d=1.5):
        rise = ground(EAST + d * dx, NORTH + d * dy) - ground(EAST - d * dx, NORTH - d * dy)
        return rise / (2 * d)

    # Rounded as they stand in the scenario: rotations about x, then y, then z.
    pitch = round(-math.atan(slope(c, s)), 3)
    roll = round(math.atan(slope(-s, c) * math.cos(pitch)), 3)
    yaw = round(YAW, 3)
    cr, sr, cp, sp, cy, sy = (f(v) for v in (roll, pitch, yaw) for f in (math.cos, math.sin))
    axes = ((cy * cp, sy * cp, -sp), (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
            (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr))
    return (EAST, NORTH, round(ground(EAST, NORTH), 3)), (roll, pitch, yaw), axes


BASE, RPY, AXES = base_pose()


def world(swing, r, z, y=SIDE):
    c, s = math.cos(swing), math.sin(swing)
    p = (r * c - y * s, r * s + y * c, z)
    return tuple(BASE[k] + sum(p[i] * AXES[i][k] for i in range(3)) for k in range(3))


def ground_z(swing, r):
    """z of the ground in the arm's plane, at r."""
    z = 0.0
    for _ in range(20):
        x, y, height = world(swing, r, z)
        z -= (height - ground(x, y)) / AXES[2][2]
    return z


def in_plane(a, x, z):
    """Bucket frame (x, z) to (r, z), directions only."""
    return -x * math.cos(a) + z * math.sin(a), x * math.sin(a) + z * math.cos(a)


def joints(r, z, a):
    """Boom, arm and bucket angles that put the lip at (r, z) with attitude a."""
    dr, dz = in_plane(a, 0, LIP)  # the pin lies above the lip, along the mouth
    pr, pz = r + dr - FOOT[0], z + dz - FOOT[1]
    reach = math.hypot(pr, pz)
    elbow = (BOOM ** 2 + ARM ** 2 - reach ** 2) / (2 * BOOM * ARM)
    assert -1 < elbow < 1, f"out of reach: r {r}, z {z}, a {a}"
    arm = math.pi - math.acos(elbow)
    boom = math.atan2(pr, pz) - math.atan2(ARM * math.sin(arm), BOOM + ARM * math.cos(arm))
    return boom - math.pi / 2, arm, math.pi + a - boom - arm


def lip(boom, arm, bucket):
    """Where joints() puts the lip: r, z, a."""
    b = boom + math.pi / 2
    c = b + arm
    d = c + bucket
    return (FOOT[0] + BOOM * math.sin(b) + ARM * math.sin(c) + LIP * math.sin(d),
            FOOT[1] + BOOM * math.cos(b) + ARM * math.cos(c) + LIP * math.cos(d), d - math.pi)


# --- motion ---------------------------------------------------------------------------------------

ENTRY = math.radians(35)  # below the ground, of the lip's path
RAKE = math.radians(17)  # of the mouth above the path: leaves the bottom plate 21 degrees clear
LAYER, DRAG, START = 0.28, 1.0, 6.4


def dig_path(layer, drag, step=0.01):
    """Lip and attitude along one pass: distance inward, height over the untouched ground, a."""
    slant = math.sin(ENTRY)
    u, z, heading = -0.5 / math.tan(ENTRY), 0.5, -ENTRY
    points = [(u, z, heading + RAKE)]

    def go(length, turn):
        nonlocal u, z, heading
        n = max(1, round(length / step))
        for _ in range(n):
            heading += turn / n / 2
            u += length / n * math.cos(heading)
            z += length / n * math.sin(heading)
            heading += turn / n / 2
            points.append((u, z, heading + RAKE))

    radius = LAYER / (1 - math.cos(ENTRY))
    go((0.5 + LAYER * (layer - 1)) / slant, 0)
    go(radius * ENTRY, ENTRY)
    go(drag, 0)
    out = math.radians(35)
    go(LAYER / (1 - math.cos(out)) * out, out)
    go((LAYER * (layer - 1) + 0.3) / math.sin(out), 0)
    return points


def ease(t):
    return t * t * (3 - 2 * t)


def move(rows, pose):
    """Appends rows along pose(0..1), as fast as the joints' speeds let it."""
    fine = [pose(i / 400) for i in range(401)]
    seconds = max(abs(q - p) * 400 / speed for before, after in zip(fine, fine[1:])
                  for p, q, speed in zip(before, after, SPEEDS))
    n = math.ceil(seconds * RATE)
    rows += [pose(i / n) for i in range(1, n + 1)]


def blend(rows, end):
    start = rows[-1]
    move(rows, lambda t: tuple(p + (q - p) * ease(t) for p, q in zip(start, end)))


def cycle(rows, swing, layer, drag):
    path = [(START - u, z, a) for u, z, a in dig_path(layer, drag)]

    def on_path(t):
        s = (t - math.sin(2 * math.pi * t) / (2 * math.pi) * 0.6) * (len(path) - 1)
        k = min(int(s), len(path) - 2)
        r, z, a = (p + (q - p) * (s - k) for p, q in zip(path[k], path[k + 1]))
        return (swing, *joints(r, z + ground_z(swing, r), a))

    start = on_path(0)
    r, z, a = lip(*start[1:])
    above = (swing, *joints(r - 0.3, z + 0.9, a))
    if rows:
        blend(rows, above)  # swing back
    else:
        rows.append(above)
    blend(rows, start)  # approach
    move(rows, on_path)  # penetrate, drag, curl
    r, z, a = lip(*rows[-1][1:])
    full = 1.35

    def lift(t):
        return (swing, *joints(r - 0.2 * ease(t), z + 1.6 * ease(min(1, 1.2 * t)),
                               a + (full - a) * ease(max(0, 1.25 * t - 0.25))))
    move(rows, lift)
    side = 1.25
    blend(rows, (side, *joints(3.6, 2.8, full)))  # swing
    r, z, a = lip(*rows[-1][1:])
    move(rows, lambda t: (side, *joints(r + 2.4 * ease(t), z - 0.4 * ease(t),
                                        a - (full + 1.15) * ease(t))))  # dump


PASSES = [(-0.30, 1), (-0.18, 1), (-0.06, 1), (0.06, 1), (-0.24, 2), (-0.12, 2)]
DUMP_ANGLE = 0.9


def loads(rows, cell=0.05, steps=8):
    """Volumes above the lip's path on a grid of columns, load by load: a rough check."""
    heights, volumes, load = {}, [], 0
    for before, after in zip(rows, rows[1:]):
        for k in range(steps):
            swing, *q = (b + (a - b) * (k + 1) / steps for b, a in zip(before, after))
            r, z, a = lip(*q)
            lanes = 28
            for m in range(lanes):
                x, y, bottom = world(swing, r, z, SIDE + WIDTH * ((m + 0.5) / lanes - 0.5))
                i, j = math.floor(x / cell), math.floor(y / cell)
                height = heights.setdefault((i, j), ground((i + 0.5) * cell, (j + 0.5) * cell))
                if height > bottom:
                    load += (height - bottom) * cell * cell
                    heights[i, j] = bottom
            if a < -DUMP_ANGLE and load:
                volumes.append(load)
                load = 0
    return volumes


def main():
    rows = []
    for swing, layer in PASSES:
        cycle(rows, swing, layer, DRAG if layer == 1 else DRAG - 0.3)
    for k, name in enumerate(NAMES):
        values = [row[k] for row in rows]
        speed = max(abs(b - a) * RATE for a, b in zip(values, values[1:]))
        print(f"{name}: {min(values):.2f} to {max(values):.2f} rad, at most {speed:.2f} rad/s, "
              f"limits {LIMITS[k][0]:.2f} to {LIMITS[k][1]:.2f}")
        assert LIMITS[k][0] <= min(values) and max(values) <= LIMITS[k][1], name
        assert speed <= (1.0 if k == 0 else 0.5), name
    for q in rows:
        assert all(abs(a - b) < 1e-9 for a, b in zip(joints(*lip(*q[1:])), q[1:]))
    with open(HERE / "zx120_dig.csv", "w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(["time", *NAMES])
        writer.writerows((f"{i / RATE:.1f}", *(f"{v:.6f}" for v in row))
                         for i, row in enumerate(rows))
    area = sum(x0 * z1 - x1 * z0 for (x0, z0), (x1, z1) in zip(PROFILE, PROFILE[1:])) / 2
    volumes = loads(rows)
    print(f"{len(rows) / RATE:.1f} s; loads {' '.join(f'{v:.3f}' for v in volumes)} m3; struck "
          f"capacity {abs(area) * WIDTH:.3f} m3")
    print(f"base: {{xyz: {list(BASE)}, rpy: {list(RPY)}}}")
    print(f"profile: {[list(p) for p in PROFILE]}")
    assert len(volumes) == len(PASSES) and all(0.3 < v < 0.6 for v in volumes)


if __name__ == "__main__":
    main()
