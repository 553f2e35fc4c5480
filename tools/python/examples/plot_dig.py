# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Digs a trench, tips beside it, and plots how the ground changed and the load over time.

    python3 plot_dig.py [FILE.png]
"""

import sys

import matplotlib  # type: ignore[import]
import numpy as np

import soilvdb

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # type: ignore[import]  # noqa: E402

RATE_HZ = 50.0
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
# Seconds, x, y, z of the lip (m), and pitch (rad; positive: the mouth looks down).
KEYS = np.array([
    [0.0, -3.0, 0.0, 0.4, 0.35], [1.5, -2.6, 0.0, -0.35, 0.35], [4.5, 0.0, 0.0, -0.40, 0.20],
    [6.0, 0.6, 0.0, 0.3, -1.30], [7.0, 0.6, 0.0, 1.8, -1.50], [9.5, -0.6, 3.5, 1.8, -1.50],
    [11.0, -0.6, 3.5, 1.8, 1.30], [12.0, -0.6, 3.5, 1.8, 1.30]])


def main() -> None:
    file = sys.argv[1] if len(sys.argv) > 1 else "dig.png"
    times = np.arange(0, KEYS[-1, 0], 1 / RATE_HZ)
    x, y, z, pitch = (np.interp(times, KEYS[:, 0], KEYS[:, i]) for i in range(1, 5))
    zero = np.zeros_like(times)
    rotations = np.stack([zero, np.sin(pitch / 2), zero, np.cos(pitch / 2)], axis=1)

    bucket = soilvdb.Bucket(width=1.2, height=0.9, profile=PROFILE)
    loam = soilvdb.Soil(repose_angle=0.61, swell=0.25)
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [bucket], soil=loam)
    loads = []
    for stroke in range(2):  # the second goes deeper
        deeper = np.stack([x, y, z - 0.3 * stroke * (z < 0), ], axis=1)
        loads.append(site.update_path(0, positions=deeper, rotations=rotations)["bucket_m3"])
    site.come_to_rest()

    across, along = np.linspace(-5, 3, 161), np.linspace(-2, 6, 161)
    # Takes some 10 ns a column of voxels, and as many microseconds more for each 8 x 8 that are new.
    dug = site.height_map(origin=(across[0], along[0]), shape=(161, 161), cell=0.05, layer="dug")
    change = -dug

    figure, (plan, over_time) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    most = np.abs(change).max()
    image = plan.imshow(change, origin="lower", extent=(-5, 3, -2, 6), cmap="RdBu_r", vmin=-most,
                        vmax=most)
    plan.contour(across, along, change, levels=np.arange(-0.95, 1, 0.1), colors="k", linewidths=0.3)
    figure.colorbar(image, ax=plan, label="change of height, m")
    plan.set(title="Cut and fill", xlabel="x, m", ylabel="y, m")
    for stroke, load in enumerate(loads):
        over_time.plot(times, load, label=f"stroke {stroke + 1}")
    over_time.set(title="Load", xlabel="time, s", ylabel="soil in the bucket, m³, loose")
    over_time.spines[["top", "right"]].set_visible(False)
    over_time.legend(frameon=False)
    figure.savefig(file, dpi=120)
    print(f"{file}: cut {site.ledger()['cut_m3']:.2f} m3, most in the bucket "
          f"{max(load.max() for load in loads):.2f} m3")


if __name__ == "__main__":
    main()
