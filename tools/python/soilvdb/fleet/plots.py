# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The plot of loads over time, with their uncertainty band."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from soilvdb.noise import Floats

MOST_PANELS = 12


def plot_loads(file: Path, times_s: Floats, drawn_m3: Mapping[str, Floats],
               recorded_m3: Mapping[str, Floats]) -> None:
    """One panel per machine. drawn_m3: (draws, times) of each. Raises OSError."""
    figures = importlib.import_module("matplotlib.figure")
    names = list(drawn_m3)[:MOST_PANELS]
    figure: Any = figures.Figure(figsize=(8, 0.8 + 2.4 * len(names)), layout="constrained")
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    for panel, name in zip(panels, names):
        p05, p95 = np.percentile(drawn_m3[name], (5, 95), axis=0)
        panel.fill_between(times_s, p05, p95, color="#7aa6c2", alpha=0.6, linewidth=0,
                           label="5 to 95 %")
        panel.plot(times_s, drawn_m3[name].mean(axis=0), color="#1f4e6b", linewidth=1.2,
                   label="mean of the draws")
        panel.plot(times_s, recorded_m3[name], color="#c2410c", linewidth=1.0, linestyle="--",
                   label="as recorded")
        panel.set_ylabel("load, m³")
        panel.set_title(name.replace("$", r"\$"), loc="left", fontsize=10)  # no mathematics
        panel.set_ylim(bottom=0)
        panel.grid(alpha=0.3)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncol=3, fontsize=8, frameon=False)
    panels[-1].set_xlabel("time, s")
    beside = file.with_name(f".{file.name}.tmp")
    figure.savefig(beside, format="png", dpi=120, metadata={"Software": None})
    os.replace(beside, file)
