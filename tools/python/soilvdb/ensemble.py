# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Uncertainty of a load while a machine digs: clones of a site, each fed states with errors."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from ._errors import NoGroundError
from ._force import Wrench
from ._soilvdb import Site, Soil, Update, _array, _step_sites, resistances
from .noise import Floats, Noise, Signal, of, turned, turned_about

_Numbers = Union[Sequence[float], npt.NDArray[np.floating[Any]]]  # read by Python 3.9
_Joints = Union[_Numbers, Mapping[str, float]]


@dataclasses.dataclass(frozen=True)
class Spread:
    """One volume of a site, and its statistics over the clones, m3."""

    recorded: float
    mean: float
    sigma: float
    p05: float
    p95: float


@dataclasses.dataclass(frozen=True)
class WrenchSpread:
    """Force (3,), N, and moment (3,), N m, on a bucket in its frame at the middle of the lip: of a
    site, and their statistics over the clones, for each component."""

    recorded: Wrench
    mean: Wrench
    sigma: Wrench
    p05: Wrench
    p95: Wrench


def _statistics(values: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean, sigma, percentiles 5 and 95 of values (clones, ...); sigma is 0 if all are the same."""
    apart = values - values[0]
    p05, p95 = np.percentile(values, (5, 95), axis=0)
    return values[0] + apart.mean(axis=0), apart.std(axis=0, ddof=1), p05, p95


class _Errors:
    """Errors of one machine's signal in each clone, as time goes on."""

    def __init__(self, random: np.random.Generator, signal: Signal, clones: int) -> None:
        self._random, self._shape = random, (clones, len(signal.bias))
        self._signal = signal
        self._bias = random.standard_normal(self._shape) * signal.bias
        self._white = any(signal.white)
        self._drift = random.standard_normal(self._shape) * signal.drift if any(signal.drift) else None

    def at(self, elapsed_s: float) -> Floats:
        """Errors (clones, axes) at this time after the last ones."""
        error = self._bias
        if self._drift is not None:
            kept = math.exp(-elapsed_s / self._signal.tau)
            step = self._random.standard_normal(self._shape) * self._signal.drift
            self._drift = kept * self._drift + math.sqrt(1 - kept**2) * step
            error = error + self._drift
        if self._white:
            error = error + self._random.standard_normal(self._shape) * self._signal.white
        return error


class _Machine:
    def __init__(self, site: Site, machine: str, noise: Noise, clones: int,
                 random: np.random.Generator) -> None:
        def errors(signal: Signal | None) -> _Errors | None:
            return _Errors(random, signal, clones) if signal and signal.parts() else None

        self.position, self.rotation = errors(noise.position), errors(noise.rotation)
        self.joints = [errors(noise.joints.get(joint, noise.all_joints))
                       for joint in site.joints(machine)]
        self.clones = clones
        self.time = math.nan

    def elapsed_s(self, time: float | None) -> float:
        """Time since the last state with a known time."""
        if time is None:
            return 0.0
        before, self.time = self.time, time
        return time - before if time > before else 0.0

    def erring_joints(self, joints: Floats, elapsed_s: float) -> Floats:
        """Joints with errors, (clones, joints)."""
        values = np.tile(joints, (self.clones, 1))
        for i, errors in enumerate(self.joints):
            if errors:
                values[:, i] += errors.at(elapsed_s)[:, 0]
        return values


def _values(soil: Soil) -> dict[str, Any]:
    """The properties of a soil by the names of its arguments."""
    names = ("repose_angle", "swell", "density", "cohesion", "friction_angle", "tool_friction",
             "adhesion")
    return {name: getattr(soil, name) for name in names}


class Ensemble:
    """A site and clones of it. The clones receive the same states with errors; the spread of their
    loads and forces is the uncertainty of the site's.

        ensemble = soilvdb.Ensemble(site, {"position": {"bias": 0.01, "white": 0.002}})
        update = ensemble.update("digger", position=position, rotation=rotation, time=t)
        update.bucket_m3, ensemble.load("digger").sigma

    noise: soilvdb.noise.Noise, or a dict with the keys position, rotation, joints and soil of a
    noise file. Position errors are along the world's axes, rotation errors about the bucket's axes;
    for a machine that joints move, both are errors of its base. Errors of the soil's density,
    cohesion, friction_angle, tool_friction and adhesion change resistance() only: the clones share
    terrain, bucket and the soil that moves. `python3 -m soilvdb.fleet uncertainty` varies those
    too. The same seed gives the same errors. An update costs one update of the site and one of each
    clone; the clones use both cores. Only one thread may use an ensemble.
    """

    def __init__(self, site: Site, noise: Noise | Mapping[str, Any], *, clones: int = 16,
                 seed: int = 0) -> None:
        """clones: their number, 2 to 1000. seed: 0 or more. Raises ValueError for other numbers, for
        a noise that is not valid, has errors of joints that no machine has, or errors of bucket,
        terrain or moving soil.
        """
        if not isinstance(noise, Noise):
            noise = of(noise)
        if not 2 <= clones <= 1000:
            raise ValueError(f"clones is {clones}; it must be 2 to 1000")
        for source in noise.sources():
            if source.startswith(("bucket.", "terrain.", "soil.repose", "soil.swell")):
                raise ValueError(f"{source}: clones share bucket, terrain and soil that moves; "
                                 "position, rotation, joints and the soil's strength may err")
        self._site, self._noise, self._seed = site, noise, seed
        self._drawn_about: dict[str, Any] = {}
        self._drawn: list[Soil] = []
        if seed < 0:
            raise ValueError(f"seed is {seed}; it must be 0 or more")
        names = site.machines
        for joint in noise.joints:
            if not any(joint in site.joints(name) for name in names):
                raise ValueError(f"joints.{joint}: no machine has that joint")
        if noise.all_joints and not any(site.joints(name) for name in names):
            raise ValueError("joints: no machine has any; leave them out")
        self._clones = tuple(site.clone() for _ in range(clones))
        self._told: set[str] = set()  # warnings of the clones
        for clone in self._clones:
            clone.limits = False  # errors may jump as no machine does
        self._machines = {
            name: _Machine(site, name, noise, clones, np.random.default_rng(
                np.random.SeedSequence(seed, spawn_key=(number,))))
            for number, name in enumerate(names)}

    def _name(self, machine: int | str) -> str:
        return machine if isinstance(machine, str) else self._site.machines[machine]

    def update(self, machine: int | str, *, position: _Numbers | None = None,
               rotation: _Numbers | None = None, pose: Any = None, joints: _Joints | None = None,
               base: Any = None, time: float | None = None) -> Update:
        """Site.update() of the site, with its arguments, and of each clone with its errors. Without
        time, drifting errors stay constant. A clone that would leave the terrain waits for the next
        state.

        Raises the errors of Site.update(); then no clone has moved either.
        """
        update = self._site.update(machine, position=position, rotation=rotation, pose=pose,
                                   joints=joints, base=base, time=time)
        own = self._machines[self._name(machine)]
        elapsed_s = own.elapsed_s(time)
        if joints is not None:
            row: Any = joints
            if hasattr(joints, "keys"):
                row = [row[name] for name in self._site.joints(machine)]
            values = own.erring_joints(_array(row, "joints"), elapsed_s)
            positions, rotations = self._site.pose(machine, values)
            if own.rotation:
                positions, rotations = turned_about(self._site.base(machine),
                                                    own.rotation.at(elapsed_s), positions,
                                                    rotations)
        else:
            if pose is not None:
                position, rotation = self._site.pose(machine)
            turn = _array((0.0, 0.0, 0.0, 1.0) if rotation is None else rotation, "rotation")
            positions = np.broadcast_to(_array(position, "position"), (own.clones, 3))
            rotations = (turned(turn, own.rotation.at(elapsed_s)) if own.rotation else
                         np.broadcast_to(turn, (own.clones, 4)))
        if own.position:
            positions = positions + own.position.at(elapsed_s)
        _, errors = _step_sites(self._clones, machine, positions, rotations, None, None, None,
                                None if time is None else np.full(own.clones, time), None,
                                self._told)
        first = next(iter(errors.values()), None)
        if first is not None and not isinstance(first, NoGroundError):
            raise first
        return update

    def load(self, machine: int | str) -> Spread:
        """The load of the machine's bucket, loose, m3."""
        return self._spread(machine, "bucket_m3")

    def cut(self, machine: int | str | None = None) -> Spread:
        """The cut of the machine, in place, m3; default: of all machines."""
        return self._spread(machine, "cut_m3")

    def resistance(self, machine: int | str, *, soil: Soil | None = None,
                   crescents: bool = True) -> WrenchSpread:
        """The force of the soil on the machine's bucket, as Site.resistance(). soil: mean values of
        what resists; default: the site's soil, and rigid soil needs one. Each clone has its own
        soil about it if the noise has errors of the soil. Clones that wait for their first state
        are left out; with fewer than two others the statistics are nan. What the formula of the
        force leaves out is in no sigma: rate, water, rock, the shape of teeth.

        Raises the errors of Site.resistance(), and ValueError (NoiseError) if errors of the soil
        are too large for its values.
        """
        recorded = self._site.resistance(machine, soil=soil, crescents=crescents)
        soils = self._soils(soil or self._site.soil) if self._noise.strength() else soil
        forces, moments = resistances(self._clones, self._name(machine), soil=soils,
                                      crescents=crescents)
        known = np.isfinite(forces).all(axis=1)
        if known.sum() < 2:
            forces = moments = np.full((2, 3), np.nan)
            known = np.ones(2, dtype=bool)
        return WrenchSpread(Wrench(recorded.force, recorded.moment),
                            *(Wrench(force, moment) for force, moment in
                              zip(_statistics(forces[known]), _statistics(moments[known]))))

    def _soils(self, mean: Soil | None) -> list[Soil]:
        """The soil of each clone."""
        assert mean is not None  # Site.resistance() has refused that
        values = _values(mean)
        if values != self._drawn_about:
            self._noise.check_strength(values)
            draws = [self._noise.draw(self._seed, number) for number in range(len(self._clones))]
            self._drawn = [Soil(**(values | {key: draw.soil(key, values[key])
                                             for key in self._noise.strength()}))
                           for draw in draws]
            self._drawn_about = values
        return self._drawn

    def _spread(self, machine: int | str | None, key: str) -> Spread:
        values = np.array([clone.ledger(machine)[key] for clone in self._clones])
        return Spread(self._site.ledger(machine)[key], *map(float, _statistics(values)))
