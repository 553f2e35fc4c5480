# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Cycles of a machine: the load that it carried away each time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from soilvdb.noise import Floats

LEAST = 0.1  # of the most that the bucket ever held: less isn't a load


@dataclasses.dataclass(frozen=True)
class Cycle:
    """A cycle: from the end of the last one to the time when the bucket lost most of its load."""

    begin_s: float
    end_s: float
    load_m3: float  # most that it held
    cut_m3: float  # taken out of the ground meanwhile
    force_n: float | None = None  # largest meanwhile, where forces are asked for

    def figures(self) -> tuple[float, ...]:
        """Load, cut and, if there is one, force."""
        known = (self.load_m3, self.cut_m3)
        return known if self.force_n is None else (*known, self.force_n)


def cycles_of(load_m3: Floats, cut_m3: Floats, times_s: Floats,
              force_n: Floats | None = None) -> list[Cycle]:
    """Completed cycles. load_m3, cut_m3: after each row; cut_m3 since the first row. force_n: the
    force's size after each row."""
    least = LEAST * float(load_m3.max(initial=0.0))
    cycles: list[Cycle] = []
    peak = trough = cut_before = 0.0
    begin_s, emptying = float(times_s[0]), False
    first = 0
    rows = zip(load_m3.tolist(), cut_m3.tolist(), times_s.tolist())
    for row, (load, cut, time_s) in enumerate(rows):
        if emptying:
            trough = min(trough, load)
            if load < trough + max(least, peak / 4):
                continue
            emptying, peak = False, load
        peak = max(peak, load)
        if peak > least and load <= peak / 2:
            force = None if force_n is None else largest(force_n[first:row + 1])
            cycles.append(Cycle(begin_s, time_s, peak, cut - cut_before, force))
            begin_s, cut_before, trough, emptying = time_s, cut, load, True
            first = row + 1
    return cycles


def largest(values: Floats) -> float:
    """The largest that is a number; 0 if none is."""
    return float(np.max(values, where=np.isfinite(values), initial=0.0))


def nearest_cycles(recorded: Sequence[Cycle], own: Sequence[Cycle]) -> list[tuple[float, ...]]:
    """The figures of a draw's cycles that match the recorded ones; NaN without a match.

    A draw's cycle matches the recorded one with the nearest end.
    """
    found = [(math.nan,) * len(cycle.figures()) for cycle in recorded]
    distance = [math.inf] * len(recorded)
    at = 0
    for cycle in own:
        while at + 1 < len(recorded) and (abs(recorded[at + 1].end_s - cycle.end_s)
                                          <= abs(recorded[at].end_s - cycle.end_s)):
            at += 1
        if recorded and abs(recorded[at].end_s - cycle.end_s) < distance[at]:
            distance[at] = abs(recorded[at].end_s - cycle.end_s)
            found[at] = cycle.figures()
    return found
