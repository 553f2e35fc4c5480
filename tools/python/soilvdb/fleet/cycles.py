# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Cycles of a machine: the load that it carried away each time."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from soilvdb.noise import Floats

LEAST = 0.1  # of the most that the bucket ever held: less isn't a load


@dataclasses.dataclass(frozen=True)
class Cycle:
    """A cycle: from the end of the last one to the time when the bucket lost most of its load."""

    begin_s: float
    end_s: float
    load_m3: float  # most that it held
    cut_m3: float  # taken out of the ground meanwhile


def cycles_of(load_m3: Floats, cut_m3: Floats, times_s: Floats) -> list[Cycle]:
    """Completed cycles. load_m3, cut_m3: after each row; cut_m3 since the first row."""
    least = LEAST * float(load_m3.max(initial=0.0))
    cycles: list[Cycle] = []
    peak = trough = cut_before = 0.0
    begin_s, emptying = float(times_s[0]), False
    for load, cut, time_s in zip(load_m3.tolist(), cut_m3.tolist(), times_s.tolist()):
        if emptying:
            trough = min(trough, load)
            if load < trough + max(least, peak / 4):
                continue
            emptying, peak = False, load
        peak = max(peak, load)
        if peak > least and load <= peak / 2:
            cycles.append(Cycle(begin_s, time_s, peak, cut - cut_before))
            begin_s, cut_before, trough, emptying = time_s, cut, load, True
    return cycles


def nearest_cycles(recorded: Sequence[Cycle], own: Sequence[Cycle]) -> list[tuple[float, float]]:
    """Load and cut of a draw's cycles that match the recorded ones; NaN without a match.

    A draw's cycle matches the recorded one with the nearest end.
    """
    found = [(math.nan, math.nan)] * len(recorded)
    distance = [math.inf] * len(recorded)
    at = 0
    for cycle in own:
        while at + 1 < len(recorded) and (abs(recorded[at + 1].end_s - cycle.end_s)
                                          <= abs(recorded[at].end_s - cycle.end_s)):
            at += 1
        if recorded and abs(recorded[at].end_s - cycle.end_s) < distance[at]:
            distance[at] = abs(recorded[at].end_s - cycle.end_s)
            found[at] = (cycle.load_m3, cycle.cut_m3)
    return found
