# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Simulates the scans of data/scanned.yaml on the ground of data/excavator.yaml, and draws
data/scanned.png: the ground before and after them.

    PYTHONPATH=build/python /usr/bin/python3 tools/guide/scan_picture.py
"""

import subprocess
import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
import yaml

import soilvdb

ROOT = Path(__file__).parents[2]
DATA, PROGRAM = ROOT / "data", ROOT / "build/soilvdb"
SHAPE, INTRINSICS = (116, 168), (225.0, 225.0, 83.5, 57.5)
SECTION_X, BASE = 512346.2, (512340.0, 5403640.0)
INK, RED, BLUE = "#222222", "#c0392b", "#1f6fb2"


def write_ply(file, points):
    with open(file, "wb") as out:
        out.write(b"ply\nformat binary_little_endian 1.0\n"
                  b"comment simulated by tools/guide/scan_picture.py\n"
                  b"element vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
                  b"end_header\n" % len(points))
        out.write(np.asarray(points, "<f4").tobytes())


def scan(truth, scenario):
    drone = scenario["sensors"]["drone"]
    sensor = soilvdb.Sensor(position=drone["at"], rotation=drone["rotation"],
                            range_sigma=drone["noise"]["range"])
    fx, fy, cx, cy = INTRINSICS
    u, v = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    for image, entry in enumerate(scenario["scans"]):
        z = soilvdb.depth_image(truth, sensor, SHAPE, INTRINSICS, seed=image)
        points = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=-1).reshape(-1, 3)
        write_ply(DATA / entry["file"], points[np.isfinite(points).all(axis=1)])


def final(scenario, out):
    soilvdb.run(scenario, out, mesh=False)
    view = out / "view.png"
    subprocess.run([PROGRAM, "export", out / "soil_final.vdb", "--to", view, "--view", "perspective"],
                   check=True, stdout=subprocess.DEVNULL)
    ground = soilvdb.snapshot(out / "soil_final.vdb")
    return soilvdb.Site(0.05, ground, [soilvdb.Bucket(1.0, 1.0)]), plt.imread(view)


def main():
    scenario = yaml.safe_load((DATA / "scanned.yaml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        truth, _ = final(DATA / "excavator.yaml", out / "true")
        scan(truth, scenario)
        after, after_view = final(DATA / "scanned.yaml", out / "after")
        blind = {key: value for key, value in scenario.items() if key not in ("sensors", "scans")}
        for key in ("raster", "motion", "urdf"):
            holder = blind["terrain"] if key == "raster" else blind["machines"][0]
            holder[key] = str(DATA / holder[key])
        (out / "blind.yaml").write_text(yaml.safe_dump(blind), encoding="utf-8")
        before, before_view = final(out / "blind.yaml", out / "before")
    draw(truth, before, after, before_view, after_view)


def draw(truth, before, after, before_view, after_view):
    figure = plt.figure(figsize=(14, 10), dpi=100)
    grid = figure.add_gridspec(2, 2, height_ratios=(1.25, 1), left=0.05, right=0.985, top=0.955,
                               bottom=0.07, hspace=0.12, wspace=0.03)
    for column, (view, title) in enumerate(((before_view, "Expected from the machine's joints alone"),
                                            (after_view, "Corrected by a depth camera"))):
        axes = figure.add_subplot(grid[0, column])
        axes.imshow(view)
        axes.set_title(title, fontsize=15, color=INK)
        axes.axis("off")
    axes = figure.add_subplot(grid[1, :])
    y = np.linspace(-2.2, 2.2, 441)
    line = np.column_stack([np.full_like(y, SECTION_X), BASE[1] + y])
    z = {name: site.heights(line) for name, site in
         (("true", truth), ("before", before), ("after", after))}
    axes.plot(y, z["true"], color=INK, lw=5, alpha=0.25, label="true ground")
    axes.plot(y, z["before"], color=RED, lw=1.8, ls="--", label="expected")
    axes.plot(y, z["after"], color=BLUE, lw=1.8, label="corrected")
    axes.set_aspect("equal")
    axes.set_xlabel("across the trench, m", fontsize=13)
    axes.set_ylabel("height, m", fontsize=13)
    axes.legend(loc="lower right", fontsize=13, frameon=False)
    axes.grid(color="#dddddd")
    figure.savefig(DATA / "scanned.png")


if __name__ == "__main__":
    main()
