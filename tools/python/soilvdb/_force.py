# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Forces of soil: their type, and what they tell of the soil."""

from __future__ import annotations

import dataclasses
import functools
import math
import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ._row_errors import covariance
from ._soilvdb import CutGeometry, Site, Soil, motions

_STEPS = 60
_FRICTION = (0.02, 1.2)  # rad, what soils have and more
_APART = 0.995           # correlation from which on rows can't tell the two apart
_ALIKE = 1e-4            # sine of the angle between both effects below which they are one
_TIE_SIGMA = 0.144       # of tool friction's share of friction, if that is anything from 1/2 to 1
_NOISY = 0.3             # misfit from which on they tell nothing


class Wrench(NamedTuple):
    """A force, (3,) N, and its moment about the middle of the lip, (3,) N m."""

    force: npt.NDArray[np.float64]
    moment: npt.NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Identified:
    """The soil that explains measured forces best.

    cohesion, Pa, and friction_angle, rad, with their standard deviations, also where errors go on
    from row to row, and infinite where rows don't tell; correlation: of the errors of
    both that the rows have. noise: misfit of a row's force as a share
    of it, root of the mean square. soil: the Soil with them. told_apart: False if other pairs of
    the two explain the rows as well, and why says so.
    """

    cohesion: float
    friction_angle: float
    cohesion_sigma: float
    friction_angle_sigma: float
    correlation: float
    noise: float
    soil: Soil
    told_apart: bool
    why: str


def _with(soil: Soil, cohesion: float, friction: float) -> Soil:
    return Soil(soil.repose_angle, soil.swell, soil.density, cohesion, friction,
                tool_friction=soil.tool_friction, adhesion=soil.adhesion)


def _geometries_of(scenario: str | os.PathLike[str], machine: int | str) -> list[CutGeometry]:
    """Site.cut_geometry() of a machine at each row of its motion, all machines at work."""
    site, rows = Site.open(scenario), motions(scenario)
    name = machine if isinstance(machine, str) else list(site.machines)[machine]
    if name not in rows:
        raise ValueError(f"the scenario has no motion of machine {name!r}; it has those of "
                         f"{', '.join(map(repr, rows)) or 'none'}")
    found, order = [], [(time, who, i) for who, own in rows.items()
                        for i, time in enumerate(own["times"])]
    for time, who, i in sorted(order, key=lambda row: float(row[0])):
        own = rows[who]
        if "joints" in own:
            state = {"joints": own["joints"][i]}
        else:
            state = {"position": own["positions"][i], "rotation": own["rotations"][i]}
        if "base" in own:
            state["base"] = (own["base"][0][i], own["base"][1][i])
        site.update(who, time=time, **state)
        if who == name:
            found.append(site.cut_geometry(who))
    return found


def identify(rows: Sequence[CutGeometry] | str | os.PathLike[str], forces: Any, *, soil: Soil,
             crescents: bool = True, machine: int | str = 0) -> Identified:
    """Cohesion and friction of the soil from forces measured in a dig.

    rows: Site.cut_geometry() at each, in the order of time and evenly apart; or the scenario of a
    run, whose motions are dug anew, for a row of the motion of `machine` each. forces: (N, 3), N, on
    the bucket in its frame, as Resistance.force; without the machine's own weight. soil: density,
    adhesion, and a first guess of the others; without tool_friction that goes with friction, as two
    thirds of it, and the sigmas know that it may be from a half of it to all.
    Least squares (Gauss and Newton) of errors that grow with the
    force. The sigmas are for errors of which a share is new in each row and a share fades over some
    rows, at most a quarter of all; the rows tell how much and how fast. An error that is the same
    in all rows is not in them.

    Raises ValueError for fewer than 4 rows, for forces that aren't finite, and if no row has soil
    ahead of its bucket.
    """
    if isinstance(rows, Site):
        raise TypeError("rows is a Site, which knows its last state only; keep its cut_geometry() "
                        "of each row, or give the scenario")
    geometries = (_geometries_of(rows, machine) if isinstance(rows, (str, os.PathLike))
                  else list(rows))
    for number, geometry in enumerate(geometries):
        if not isinstance(geometry, CutGeometry):
            raise TypeError(f"rows: row {number} is {type(geometry).__name__}; it must be what "
                            "Site.cut_geometry() gave")
    if not isinstance(soil, Soil):
        raise TypeError(f"soil must be soilvdb.Soil, not {type(soil).__name__}")
    try:
        measured = np.asarray(forces, float)
    except (TypeError, ValueError):
        raise TypeError("forces must be an array (N, 3) of numbers, N") from None
    if measured.ndim != 2 or measured.shape[1] != 3 or len(measured) != len(geometries):
        raise ValueError(f"forces has the shape {measured.shape}; it must be "
                         f"({len(geometries)}, 3), a row for each geometry")
    if not np.isfinite(measured).all():
        raise ValueError(f"forces: row {int(np.argmin(np.isfinite(measured).all(1)))} is not finite")
    if len(measured) < 4:
        raise ValueError(f"there are {len(measured)} rows; two unknowns need 4 or more")

    ties = 2 / 3 if soil.tool_friction is None else 0.0

    @functools.lru_cache(maxsize=2)  # a step that is taken, and the next trial
    def misfits(cohesion: float, friction: float) -> tuple[Any, Any, Any]:
        """Misfit of each row's force, its derivatives by cohesion, friction and the tie of tool
        friction to it, and the force's size."""
        now = _with(soil, cohesion, friction)
        felt = [geometry.resistance(now, crescents=crescents) for geometry in geometries]
        model, j = np.array([r.force for r in felt]), np.array([r.jacobian for r in felt])
        by = np.stack([j[:, :, 1], j[:, :, 2] + ties * j[:, :, 3], friction * j[:, :, 3]], axis=2)
        return measured - model, by, np.linalg.norm(model, axis=1)

    def weighted(cohesion: float, friction: float) -> tuple[Any, Any, Any, Any]:
        """Misfits and derivatives over the forces' sizes, a misfit at other values over the same
        sizes, and the numbers of the rows."""
        misfit, by, size = misfits(cohesion, friction)
        # Rows whose force depends on the soil, not only on the load.
        used = np.abs(by[:, :, 1]).max(1) > 1e-6 * np.maximum(size, 1e-9)
        if used.sum() < 4:
            raise ValueError("fewer than 4 rows have soil ahead of the bucket")
        return ((misfit[used] / size[used, None]).ravel(),
                (by[used] / size[used, None, None]).reshape(-1, 3),
                lambda c, f: (misfits(c, f)[0][used] / size[used, None]).ravel(),
                np.flatnonzero(used))

    # Cohesion in units in which both unknowns change a force about as much.
    scale = 1e4
    low, high = _FRICTION
    starts = [(soil.cohesion if soil.cohesion is not None else 0.3 * scale,
               soil.friction_angle or soil.repose_angle or 0.55)]
    starts += [(scale, 0.35), (0.2 * scale, 0.75)]
    best: tuple[float, float, float] | None = None
    for cohesion, friction in starts:
        damping, cost = 1e-3, math.inf
        for _ in range(_STEPS):
            misfit, by, elsewhere, _ = weighted(cohesion, friction)
            cost = float(misfit @ misfit)
            by = by[:, :2] * [scale, 1.0]
            normal, right = by.T @ by, by.T @ misfit
            moved = False
            for _ in range(12):
                step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), right)
                c = max(0.0, cohesion + scale * step[0])
                f = min(high, max(low, friction + step[1]))
                new = elsewhere(c, f)
                if new @ new < cost:
                    moved = abs(c - cohesion) > 1e-7 * scale or abs(f - friction) > 1e-9
                    cohesion, friction, damping = c, f, damping / 5
                    break
                damping *= 5
            if not moved:
                break
        if best is None or cost < best[0]:
            best = (cost, cohesion, friction)
    assert best is not None
    _, cohesion, friction = best
    misfit, by, _, numbers = weighted(cohesion, friction)
    by, by_tie = by[:, :2] * [scale, 1.0], by[:, 2]
    noise = math.sqrt(3 * float(misfit @ misfit) / max(1, len(misfit) - 2))
    normal = by.T @ by
    lengths = np.sqrt(np.diag(normal))
    alike = float(normal[0, 1] / max(lengths[0] * lengths[1], 1e-300))
    if 1 - alike**2 > _ALIKE**2:
        spread = covariance(numbers.astype(float), by.reshape(-1, 3, 2), misfit.reshape(-1, 3))
        alone = np.sqrt(np.diag(spread))
        correlation = float(spread[0, 1] / max(alone[0] * alone[1], 1e-300))
        off = ties and _TIE_SIGMA * np.linalg.solve(normal, by.T @ by_tie)
        sigmas = np.hypot(alone, off)
    else:
        sigmas, correlation = np.array([math.inf, math.inf]), -math.copysign(1.0, alike)
    why = ""
    if abs(correlation) > _APART:
        why = ("cohesion and friction explain these rows in other pairs as well; take rows of "
               "other depths")
    elif noise > _NOISY:
        why = (f"rows differ from the best soil's forces by {100 * noise:.0f} %; check signs, frame "
               "and outliers of the forces")
    elif cohesion == 0 or friction in (low, high):
        why = "the best values are at the border of what soils have; check forces and density"
    return Identified(cohesion, friction, scale * float(sigmas[0]), float(sigmas[1]), correlation,
                      noise, _with(soil, cohesion, friction), why == "", why)
