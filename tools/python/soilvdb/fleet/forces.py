# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of draws: the largest of each, and force.csv with those of each row."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from soilvdb.noise import Floats

from .cycles import largest
from .spread import spread

FORCES = "force.csv"
MOST_ROWS = 400  # of each machine
COLUMNS = ("force_x_n", "force_y_n", "force_z_n", "moment_y_nm")  # as in updates.csv


def sizes_n(force: Floats) -> Floats:
    """Sizes (rows,) of forces, N, as Dug.force has them."""
    return np.asarray(np.linalg.norm(force[:, :3], axis=1))


def largest_n(force: Floats) -> float:
    return largest(sizes_n(force))


def kept_rows(count: int) -> npt.NDArray[np.int64]:
    """Rows of which a study keeps the forces: all, or some with the first and the last."""
    return np.unique(np.linspace(0, count - 1, min(count, MOST_ROWS)).astype(np.int64))


def write_forces(out: Path, times_s: Mapping[str, Floats],
                 recorded: Mapping[str, npt.NDArray[np.float32]],
                 drawn: Sequence[Mapping[str, npt.NDArray[np.float32]]]) -> None:
    """Writes force.csv, or removes an earlier study's if there are no forces. times_s: of each
    machine's rows."""
    if not times_s:
        (out / FORCES).unlink(missing_ok=True)
        return
    with open(out / ".force.tmp", "w", newline="", encoding="utf-8") as text:
        table = csv.writer(text, lineterminator="\n")
        table.writerow(["time", "machine"] + [
            column + of for column in COLUMNS for of in ("", "_mean", "_sigma", "_p05", "_p95")])
        for name, times in times_s.items():
            of_draws = np.array([forces[name] for forces in drawn], dtype=float)
            for i, time_s in enumerate(times[kept_rows(len(times))].tolist()):
                figures: list[float] = []
                for k, value in enumerate(recorded[name][i].tolist()):
                    figures += [value, *spread(of_draws[:, i, k]).values()]
                table.writerow([time_s, name] + [_text(figure) for figure in figures])
    os.replace(out / ".force.tmp", out / FORCES)


def _text(figure: float) -> str:
    return repr(figure) if np.isfinite(figure) else ""
