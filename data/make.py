#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Makes half_sine.csv, hills.tif and excavator.csv, and checks what they promise.

Run by maintainers only; what it makes is in the repository. Python 3 and gdal_translate, nothing
else. The arm's dimensions are read from excavator.urdf; the bucket, base and lip below are those of
excavator.yaml.
"""
import csv
import math
import pathlib
import subprocess
import tempfile
import xml.etree.ElementTree as ET

HERE = pathlib.Path(__file__).resolve().parent

# --- half sine ------------------------------------------------------------------------------------

HALF_SINE_ROWS = 2001


def half_sine():
    rows = []
    for i in range(HALF_SINE_ROWS):
        t = i / (HALF_SINE_ROWS - 1)
        x = 2 - 0.5 * math.cos(math.pi * t)
        z = -0.25 * math.sin(math.pi * t) if 0 < t < 1 else 0.0
        rows.append((f"{t:.4f}", f"{x:.9f}", "0", f"{z:.9f}"))
    write_csv("half_sine.csv", ["time", "x", "y", "z"], rows)
    xz = [(float(r[1]), float(r[3])) for r in rows]
    area = sum((b[0] - a[0]) * -(a[1] + b[1]) / 2 for a, b in zip(xz, xz[1:]))
    exact = math.pi * 0.5 * 0.25 / 2
    error = abs(area / exact - 1)
    print(f"half_sine: {0.2 * area:.9f} m3, exact {0.2 * exact:.9f} m3, relative error {error:.1e}")
    assert error < 1e-5


# --- hills ----------------------------------------------------------------------------------------

POSTS, SPACING = 160, 0.5
WEST, SOUTH = 512300.0, 5403600.0  # corner of the raster, EPSG:25832
HILLS = [  # east and north of the corner, height, radius, all m
    (14, 62, 6.5, 17), (66, 66, 4.0, 13), (70, 18, 7.0, 16), (20, 12, 3.0, 11), (44, 50, 1.2, 9),
    (52, 33, -0.6, 7)]


def hill_height(x, y):
    u, v = x - WEST, y - SOUTH
    z = 430 + 0.015 * u - 0.02 * v + 0.12 * math.sin(u / 5.1) * math.cos(v / 6.3 + 0.4)
    z += 0.04 * math.sin(u / 1.3 + 1) * math.sin(v / 1.7)
    return z + sum(h * math.exp(-((u - a) ** 2 + (v - b) ** 2) / (2 * r * r))
                   for a, b, h, r in HILLS)


def post(i, j):
    """Height of the post i to the east, j to the north, as it stands in the raster."""
    return round(hill_height(WEST + (i + 0.5) * SPACING, SOUTH + (j + 0.5) * SPACING), 3)


def ground(x, y):
    u, v = (x - WEST) / SPACING - 0.5, (y - SOUTH) / SPACING - 0.5
    i, j = math.floor(u), math.floor(v)
    u, v = u - i, v - j
    return ((1 - u) * (1 - v) * post(i, j) + u * (1 - v) * post(i + 1, j)
            + (1 - u) * v * post(i, j + 1) + u * v * post(i + 1, j + 1))


def hills():
    with tempfile.TemporaryDirectory() as folder:
        asc = pathlib.Path(folder, "hills.asc")
        lines = [f"ncols {POSTS}", f"nrows {POSTS}", f"xllcorner {WEST}", f"yllcorner {SOUTH}",
                 f"cellsize {SPACING}", "NODATA_value -9999"]
        for j in reversed(range(POSTS)):
            lines.append(" ".join(f"{post(i, j):.3f}" for i in range(POSTS)))
        asc.write_text("\n".join(lines) + "\n")
        subprocess.run(["gdal_translate", "-q", "-a_srs", "EPSG:25832", "-ot", "Float32",
                        "-co", "COMPRESS=DEFLATE", "-co", "PREDICTOR=3", "-co", "TILED=YES",
                        str(asc), str(HERE / "hills.tif")], check=True)
    (HERE / "hills.tif.aux.xml").unlink(missing_ok=True)


# --- excavator ------------------------------------------------------------------------------------
# The arm works in a vertical plane: r outward from the swing axis, z up from base_link. The bucket's
# attitude there is `a`, the angle by which its mouth looks above the horizontal.

BASE = (512340.0, 5403640.0, 431.85)
YAW = 0.0
WIDTH, HEIGHT = 1.2, 1.15
PROFILE = [(0, 0), (-0.45, 0.09), (-0.80, 0.32), (-0.92, 0.62), (-0.85, 0.90), (-0.55, 1.10),
           (0, 1.15)]
LIP_RADIUS, LIP_PITCH = 1.42, 1.5  # the lip in bucket_link: xyz and rpy of excavator.yaml
RATE = 10  # rows per second


def machine():
    joints = {j.get("name"): j for j in ET.parse(HERE / "excavator.urdf").getroot().iter("joint")}
    xyz = {n: [float(v) for v in j.find("origin").get("xyz").split()] for n, j in joints.items()}
    limits = {n: tuple(float(j.find("limit").get(k)) for k in ("lower", "upper", "velocity"))
              for n, j in joints.items() if j.find("limit") is not None}
    foot = (xyz["boom_joint"][0], xyz["swing_joint"][2] + xyz["boom_joint"][2])
    return foot, xyz["arm_joint"][0], xyz["bucket_joint"][0], limits


FOOT, BOOM, ARM, LIMITS = machine()


def in_plane(a, x, z):
    """Bucket frame (x, z) to the arm's plane, directions only."""
    return -x * math.cos(a) + z * math.sin(a), x * math.sin(a) + z * math.cos(a)


def joints(r, z, a):
    """Boom, arm and bucket angles that put the lip at (r, z) with attitude a."""
    # bucket_link's x points from the pin to the lip; in the bucket frame that is at LIP_PITCH.
    dr, dz = in_plane(a, math.cos(LIP_PITCH), -math.sin(LIP_PITCH))
    pr, pz = r - LIP_RADIUS * dr - FOOT[0], z - LIP_RADIUS * dz - FOOT[1]
    reach = math.hypot(pr, pz)
    elbow = (BOOM ** 2 + ARM ** 2 - reach ** 2) / (2 * BOOM * ARM)
    assert -1 < elbow < 1, f"out of reach: r {r}, z {z}, a {a}"
    arm = math.acos(elbow) - math.pi
    boom = math.atan2(pz, pr) - math.atan2(ARM * math.sin(arm), BOOM + ARM * math.cos(arm))
    bucket = math.atan2(dz, dr) - boom - arm
    return boom, arm, math.remainder(bucket + 0.9, 2 * math.pi) - 0.9


def lip(boom, arm, bucket):
    """Where joints() puts the lip: r, z, a."""
    b, c, d = boom, boom + arm, boom + arm + bucket
    r = FOOT[0] + BOOM * math.cos(b) + ARM * math.cos(c) + LIP_RADIUS * math.cos(d)
    z = FOOT[1] + BOOM * math.sin(b) + ARM * math.sin(c) + LIP_RADIUS * math.sin(d)
    return r, z, math.remainder(LIP_PITCH + math.pi - d, 2 * math.pi)


def world(swing, r):
    return BASE[0] + r * math.cos(YAW + swing), BASE[1] + r * math.sin(YAW + swing)


def ground_z(swing, r):
    return ground(*world(swing, r)) - BASE[2]


def ease(t):
    return t * t * (3 - 2 * t)


ENTRY, EXIT = math.radians(40), math.radians(48)  # from the horizontal
RADIUS_IN, RADIUS_OUT = 1.35, 1.5
FAR_END = 8.7  # of the trench at the ground's surface, from the swing axis
CLEAR = 0.40  # above the ground before and after a pass
# Depth of the floor, where the pass begins from the far end, drag along the floor: two passes to a
# layer while it is long, from the far end to the near one.
PASSES = [(0.30, 0.0, 0.75), (0.30, 2.05, 0.80), (0.60, 0.0, 0.65), (0.60, 1.80, 0.75),
          (0.90, 0.0, 0.50), (0.90, 1.50, 0.55), (1.20, 0.0, 0.85), (1.50, 0.0, 0.60)]
# Where the loads go: swing, lip from the swing axis, height over the ground there, and the lip's
# height over the ground as it tips.
TRUCK, HEAP = (1.25, 6.1, 3.6), (-0.64, 6.5, 2.4)
LEVEL, TIP = 1.27, 2.25  # attitude of a load that is carried, and how far it is tipped
LOADS = [HEAP, TRUCK, TRUCK, HEAP, TRUCK, TRUCK, HEAP, TRUCK]


def dig_path(depth, begin, drag, step=0.01):
    """Lip and attitude along one pass: distance inward from the far end, height over the untouched
    ground, a. The mouth looks along the path; the floor's clearance angle keeps the body out of the
    ground."""
    u, z, a = begin - CLEAR / math.tan(ENTRY), CLEAR, -ENTRY
    points = [(u, z, a)]

    def go(length, turn):
        nonlocal u, z, a
        n = max(1, round(length / step))
        for _ in range(n):
            a += turn / n / 2
            u += length / n * math.cos(a)
            z += length / n * math.sin(a)
            a += turn / n / 2
            points.append((u, z, a))

    go((CLEAR + depth - RADIUS_IN * (1 - math.cos(ENTRY))) / math.sin(ENTRY), 0)
    go(RADIUS_IN * ENTRY, ENTRY)
    go(drag, 0)
    go(RADIUS_OUT * EXIT, EXIT)
    go((CLEAR - z) / math.sin(EXIT), 0.3)
    return points


def blend(rows, start, end, seconds):
    n = round(seconds * RATE)
    rows += [tuple(s + (e - s) * ease(i / n) for s, e in zip(start, end)) for i in range(1, n + 1)]


def cycle(rows, dig, unload):
    depth, begin, drag = dig
    path = [(FAR_END - u, z, a) for u, z, a in dig_path(depth, begin, drag)]
    start = (0, *joints(path[0][0], path[0][1] + ground_z(0, path[0][0]), path[0][2]))
    above = (0, *joints(path[0][0] - 0.4, 1.5, -0.6))
    if rows:  # swing back high and open the bucket on the way
        blend(rows, rows[-1], above, max(2.0, abs(rows[-1][0]) * 2.2))
    else:
        rows.append(above)
    blend(rows, above, start, 1.3)
    n = round((1.2 + 0.0075 * len(path)) * RATE)
    for i in range(1, n + 1):
        t = i / n  # starts and stops gently
        s = (t - math.sin(2 * math.pi * t) / (2 * math.pi) * 0.6) * (len(path) - 1)
        k = min(int(s), len(path) - 2)
        r, z, a = (p + (q - p) * (s - k) for p, q in zip(path[k], path[k + 1]))
        rows.append((0, *joints(r, z + ground_z(0, r), a)))
    r, z, a = lip(*rows[-1][1:])
    n = round(2.4 * RATE)
    for i in range(1, n + 1):  # curl and lift
        t = i / n
        rows.append((0, *joints(r + 0.9 * ease(t), z + 1.5 * ease(min(1, 1.25 * t)),
                                a + (LEVEL - a) * ease(t))))
    side, reach, height = unload
    height += ground_z(side, reach)
    blend(rows, rows[-1], (side, *joints(reach, height, LEVEL)), max(2.2, abs(side) * 2.4))
    n = round(2.7 * RATE)
    for i in range(1, n + 1):  # tip about the lip
        t = i / n
        rows.append((side, *joints(reach, height - 0.3 * ease(t), LEVEL - TIP * ease(t))))


def excavator():
    rows = []
    for dig, unload in zip(PASSES, LOADS):
        cycle(rows, dig, unload)
    names = ["swing_joint", "boom_joint", "arm_joint", "bucket_joint"]
    for i, name in enumerate(names):
        values = [row[i] for row in rows]
        speed = max(abs(b - a) * RATE for a, b in zip(values, values[1:]))
        lower, upper, fastest = LIMITS.get(name, (-math.inf, math.inf, 1.2))
        print(f"{name}: {min(values):.2f} to {max(values):.2f} rad, at most {speed:.2f} rad/s")
        assert lower <= min(values) and max(values) <= upper and speed <= fastest, name
    write_csv("excavator.csv", ["time", *names],
              [(f"{i / RATE:.1f}", *(f"{v:.6f}" for v in row)) for i, row in enumerate(rows)])
    check_volume(rows)


def check_volume(rows, cell=0.05, steps=8):
    """The volume above the lip's path, and what the body takes beside it, on a grid of columns, of
    soil that neither falls nor swells."""
    heights = {}

    def column(i, j):
        if (i, j) not in heights:
            heights[i, j] = ground(BASE[0] + (i + 0.5) * cell, BASE[1] + (j + 0.5) * cell)
        return heights[i, j]

    def cut(swing, r, z):
        volume = 0
        half = WIDTH / 2
        c, s = math.cos(YAW + swing), math.sin(YAW + swing)
        lanes = 2 * round(WIDTH / cell)
        for k in range(lanes):
            y = -half + (k + 0.5) * WIDTH / lanes
            i, j = math.floor((r * c - y * s) / cell), math.floor((r * s + y * c) / cell)
            h = column(i, j)
            if h > BASE[2] + z:
                volume += (h - BASE[2] - z) * cell * cell
                heights[i, j] = BASE[2] + z
        return volume

    captured, displaced, load, loads = 0, 0, 0, []
    for before, after in zip(rows, rows[1:]):
        for k in range(steps):
            q = [b + (a - b) * (k + 1) / steps for b, a in zip(before, after)]
            r, z, a = lip(*q[1:])
            through = cut(q[0], r, z)
            captured += through
            load += through
            for (x0, z0), (x1, z1) in zip(PROFILE, PROFILE[1:]):
                for m in range(1, 8):
                    dr, dz = in_plane(a, x0 + (x1 - x0) * m / 7, z0 + (z1 - z0) * m / 7)
                    displaced += cut(q[0], r + dr, z + dz)
            if a < 0 and q[0] and load:
                loads.append(load)
                load = 0
    print(f"excavator: {len(rows) / RATE:.0f} s, captured {captured:.2f} m3, displaced "
          f"{displaced:.3f} m3, loads " + " ".join(f"{v:.2f}" for v in loads))
    assert len(loads) == len(PASSES) and all(0.6 < v < 1 for v in loads)
    assert displaced < 0.05 * captured


def write_csv(name, header, rows):
    with open(HERE / name, "w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


if __name__ == "__main__":
    half_sine()
    hills()
    excavator()
