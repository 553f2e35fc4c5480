# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of recorded machines, ground and soil as standard deviations, and draws of them.

    noise = soilvdb.noise.read("noise.yaml")
    draw = noise.draw(seed=1, number=0)
    position_m, rotation_rad = draw.base("digger", times)

A signal's error has a constant part (calibration), a drifting part (GNSS: a Gauss-Markov process),
and a white part that is new in each row. All have mean 0 and a given standard deviation.
"""

from __future__ import annotations

import dataclasses
import difflib
import importlib
import math
import os
import re
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

PARTS = ("bias", "drift", "white")
AXES = ("x", "y", "z")
KEYS: dict[str, tuple[str, ...]] = {
    "position": PARTS, "rotation": PARTS, "bucket": ("width", "height"),
    "terrain": ("bias", "correlated", "white", "cell"),
    "soil": ("repose", "swell", "density", "cohesion", "friction_angle", "tool_friction",
             "adhesion")}
FINEST = 1 / 500  # of the range of what is correlated
MOST = {"position": 10.0, "rotation": 0.5, "joint": 0.5, "bucket": 1.0, "terrain": 10.0, "soil": 1.0}
STRENGTH = KEYS["soil"][2:]  # that a force depends on
POSITIVE = {"density": 1e4, "cohesion": 1e8, "adhesion": 1e8}  # of soil, with their largest sigmas
SOIL_LIMITS = {"repose": (0.02, 1.5), "swell": (0.0, 3.0), "friction_angle": (0.0, 1.5),
               "tool_friction": (0.0, 1.5)}  # of what isn't in POSITIVE


class NoiseError(ValueError):
    """A wrong noise file, in one line: where, what is wrong, what would be right."""


@dataclasses.dataclass(frozen=True)
class Signal:
    """Standard deviations of the parts of a signal: per axis (three), or of a joint."""

    bias: tuple[float, ...]
    drift: tuple[float, ...]
    tau: float  # s, in which what drifts is forgotten to 1/e
    white: tuple[float, ...]

    def parts(self) -> list[str]:
        return [part for part in PARTS if any(getattr(self, part))]


@dataclasses.dataclass(frozen=True)
class TerrainNoise:
    """Standard deviations of a terrain's heights, m."""

    bias: float = 0.0
    correlated: float = 0.0
    length: float = 0.0  # m, at which the spherical variogram of that has its sill
    white: float = 0.0
    cell: float | None = None  # m, distance of the heights; None: a raster's own

    def parts(self) -> list[str]:
        return [part for part in ("bias", "correlated", "white") if getattr(self, part)]


@dataclasses.dataclass(frozen=True)
class Noise:
    """Unknown errors, as standard deviations. Missing ones are 0."""

    position: Signal | None = None  # m, of the bucket's frame, or of the base of a machine with joints
    rotation: Signal | None = None  # rad, about the axes of that
    joints: Mapping[str, Signal] = dataclasses.field(default_factory=dict)
    all_joints: Signal | None = None  # of those that `joints` doesn't have; rad, or m
    bucket: Mapping[str, float] = dataclasses.field(default_factory=dict)  # width, height, m
    terrain: TerrainNoise = TerrainNoise()
    # Keys as in a noise file; rad, 1, kg/m3 or Pa.
    soil: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def sources(self) -> list[str]:
        """Names of all sources of errors, such as position.bias, joints.boom.white,
        bucket.width."""
        names = [f"{name}.{part}" for name in ("position", "rotation")
                 for part in (getattr(self, name).parts() if getattr(self, name) else [])]
        if self.all_joints:
            names += [f"joints.{part}" for part in self.all_joints.parts()]
        names += [f"joints.{joint}.{part}" for joint, signal in self.joints.items()
                  for part in signal.parts()]
        names += [f"bucket.{name}" for name, sigma in self.bucket.items() if sigma]
        names += [f"terrain.{part}" for part in self.terrain.parts()]
        return names + [f"soil.{name}" for name, sigma in self.soil.items() if sigma]

    def strength(self) -> list[str]:
        """The properties of soil that err and that a force depends on."""
        return [key for key in STRENGTH if self.soil.get(key)]

    def check_strength(self, soil: Mapping[str, float | None]) -> None:
        """Raises NoiseError if draws of this soil's properties could not have these sigmas."""
        for key in self.strength():
            sigma, value = self.soil[key], soil.get(key)
            if value is None:
                raise NoiseError(f"soil.{key}: the soil's {key} isn't given; an error needs a "
                                 "value that it is added to")
            if key in POSITIVE and sigma > value:
                raise NoiseError(f"soil.{key} is {sigma:g}; it must be at most the soil's {key}, "
                                 f"{value:g}")
            room = math.inf if key in POSITIVE else min(value - SOIL_LIMITS[key][0],
                                                        SOIL_LIMITS[key][1] - value)
            if sigma > room / 3:
                low, high = SOIL_LIMITS[key]
                raise NoiseError(f"soil.{key} is {sigma:g}; it must be at most a third of what the "
                                 f"soil's {key}, {value:g}, is from {low:g} and {high:g} rad")

    def moves_base(self) -> bool:
        return any(name.startswith(("position.", "rotation.")) for name in self.sources())

    def draw(self, seed: int, number: int | Mapping[str, int] = 0) -> Draw:
        """One realisation, deterministic. number: of the draw, or one for each source that errs in
        it; other sources do not err."""
        if isinstance(number, int):
            number = dict.fromkeys(self.sources(), number)
        return Draw(self, seed, dict(number))


@dataclasses.dataclass(frozen=True)
class Draw:
    """A realisation: errors to add to the recorded values."""

    noise: Noise
    seed: int
    numbers: Mapping[str, int]  # of the realisation of each source that errs

    def _random(self, source: str, of: str = "") -> np.random.Generator | None:
        if source not in self.numbers:
            return None
        key = (zlib.crc32(source.encode()), zlib.crc32(of.encode()), self.numbers[source])
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=key))

    def _signal(self, name: str, of: str, signal: Signal | None, times: Floats) -> Floats:
        """Errors (N, axes) at these times."""
        axes = len(signal.bias) if signal else 0
        error = np.zeros((len(times), axes))
        if signal is None:
            return error
        if random := self._random(f"{name}.bias", of):
            error += random.standard_normal(axes) * signal.bias
        if random := self._random(f"{name}.drift", of):
            error += gauss_markov(random, times, signal.tau, axes) * signal.drift
        if random := self._random(f"{name}.white", of):
            error += random.standard_normal((len(times), axes)) * signal.white
        return error

    def base(self, machine: str, times: Floats) -> tuple[Floats, Floats]:
        """Errors of position, m, world, and of rotation, rad, (N, 3) each, at times (N,), s."""
        errors = [self._signal(name, machine, signal, times)
                  for name, signal in (("position", self.noise.position),
                                       ("rotation", self.noise.rotation))]
        whole = [error if error.shape[1] else np.zeros((len(times), 3)) for error in errors]
        return whole[0], whole[1]

    def joints(self, machine: str, times: Floats, joints: Sequence[str]) -> Floats:
        """Errors (N, joints) of these joints, rad or m, at times (N,), s."""
        columns = []
        for joint in joints:
            own = self.noise.joints.get(joint)
            columns.append(self._signal(f"joints.{joint}", machine, own, times) if own else
                           self._signal("joints", f"{machine}/{joint}", self.noise.all_joints,
                                        times))
        return np.hstack([c if c.shape[1] else np.zeros((len(times), 1)) for c in columns])

    def scalar(self, source: str, sigma: float, low: float, high: float, of: str = "") -> float:
        """An error with this standard deviation within [low, high]; 0 if the source does not
        err."""
        random = self._random(source, of)
        if random is None:
            return 0.0
        while not low <= (error := sigma * float(random.standard_normal())) <= high:
            pass
        return error

    def soil(self, key: str, value: float) -> float:
        """A property of soil as drawn. Density, cohesion and adhesion are lognormal, with the value
        as mean and the given sigma; others are normal, and drawn again beyond SOIL_LIMITS."""
        source, sigma = f"soil.{key}", self.noise.soil.get(key, 0.0)
        if key not in POSITIVE:
            low, high = SOIL_LIMITS[key]
            return value + self.scalar(source, sigma, min(low - value, 0.0), max(high - value, 0.0))
        random = self._random(source)
        if random is None:
            return value
        variance = math.log1p((sigma / value)**2)
        normal = float(random.standard_normal())
        return value * math.exp(math.sqrt(variance) * normal - variance / 2)

    def terrain(self, shape: tuple[int, int], spacing: tuple[float, float]) -> Floats:
        """Errors (ny, nx) of heights with the spacing (dx, dy), m."""
        terrain = self.noise.terrain
        error = np.zeros(shape)
        if random := self._random("terrain.bias"):
            error += terrain.bias * float(random.standard_normal())
        if random := self._random("terrain.correlated"):
            error += terrain.correlated * correlated_field(random, shape, spacing, terrain.length)
        if random := self._random("terrain.white"):
            error += terrain.white * random.standard_normal(shape)
        return error


def gauss_markov(random: np.random.Generator, times: Floats, tau: float, axes: int = 1) -> Floats:
    """A stationary Gauss-Markov process with variance 1 and correlation exp(-|dt| / tau), at
    non-decreasing times (N,): (N, axes)."""
    normal = random.standard_normal((len(times), axes))
    value = np.empty_like(normal)
    at = 0
    while at < len(times):
        # x(t) exp(t / tau) is a sum of independent steps; pieces avoid overflow of the exponential.
        end = max(at + 1, int(np.searchsorted(times, times[at] + 20 * tau, "right")))
        grown = np.exp((times[at:end] - times[at]) / tau)
        steps = np.sqrt(np.maximum(0.0, np.diff(grown**2, prepend=1.0)))[:, None] * normal[at:end]
        if at == 0:
            steps[0] = normal[0]
        else:
            kept = math.exp(-(times[at] - times[at - 1]) / tau)
            steps[0] = kept * value[at - 1] + math.sqrt(1 - kept**2) * normal[at]
        value[at:end] = np.cumsum(steps, axis=0) / grown[:, None]
        at = end
    return value


def correlated_field(random: np.random.Generator, shape: tuple[int, int],
                     spacing: tuple[float, float], length: float) -> Floats:
    """A Gaussian field (ny, nx) with variance 1 and a spherical variogram of this range, m, by
    circulant embedding: the torus is so large that its ends do not correlate. Points closer than
    FINEST of the range are interpolated, so that a long range costs no more."""
    apart = (spacing[1], spacing[0])
    steps = [max(1, int(FINEST * length / d)) for d in apart]
    coarse = [-(-(n - 1) // step) + 1 for n, step in zip(shape, steps)]
    reach = [math.ceil(length / (d * step)) for d, step in zip(apart, steps)]
    torus = [max(n, r) + r for n, r in zip(coarse, reach)]
    lag = [np.minimum(np.arange(n), n - np.arange(n)) * d * step
           for n, d, step in zip(torus, apart, steps)]
    h = np.minimum(1.0, np.hypot(lag[0][:, None], lag[1][None, :]) / length)
    power = np.maximum(0.0, np.fft.fft2(1 - 1.5 * h + 0.5 * h**3).real)
    field = np.fft.ifft2(np.sqrt(power) * np.fft.fft2(random.standard_normal(torus))).real
    return _between(_between(field[:coarse[0], :coarse[1]], steps[0], shape[0]).T, steps[1],
                    shape[1]).T


def _between(values: Floats, step: int, count: int) -> Floats:
    """`count` rows: each `step`-th is given, the others are interpolated linearly."""
    if step == 1:
        return values
    row, part = np.divmod(np.arange(count), step)
    share = (part / step)[:, None]
    return np.asarray((1 - share) * values[row] + share * values[np.minimum(row + 1, len(values) - 1)])


def product(a: Floats, b: Floats) -> Floats:
    """Product a b of quaternions x, y, z, w, (N, 4) or (4,): first b, then a."""
    x, y, z, w = a.T
    left = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]])
    return np.asarray(b @ left.T if a.ndim == 1 else np.einsum("ijn,nj->ni", left, b))


def rotation_of(vectors: Floats) -> Floats:
    """Quaternions (N, 4) x, y, z, w of rotation vectors (N, 3), rad."""
    half = 0.5 * np.sqrt((vectors * vectors).sum(axis=1))
    q = np.empty((len(vectors), 4))
    q[:, :3] = vectors * (0.5 * np.sinc(half / np.pi))[:, None]
    q[:, 3] = np.cos(half)
    return q


def turned(rotations: Floats, errors: Floats) -> Floats:
    """Unit quaternions (N, 4), or one for all, rotated about their own axes by rotation vectors (N,
    3), rad."""
    q = product(np.asarray(rotations, dtype=float), rotation_of(errors))
    return np.asarray(q / np.sqrt((q * q).sum(axis=1))[:, None])


def turned_about(base: tuple[Floats, Floats], errors: Floats, positions: Floats,
                 rotations: Floats) -> tuple[Floats, Floats]:
    """Poses (N, 3), (N, 4), if a base (3,), (4,) errs by rotation vectors (N, 3)."""
    conjugate = np.array([-1.0, -1.0, -1.0, 1.0])
    one = np.tile(base[1] * conjugate, (len(errors), 1))
    turn = product(product(base[1], rotation_of(errors)), one)
    arm = np.concatenate([positions - base[0], np.zeros((len(positions), 1))], axis=1)
    moved = product(product(turn, arm), turn * conjugate)[:, :3]
    q = product(turn, rotations)
    return base[0] + moved, np.asarray(q / np.sqrt((q * q).sum(axis=1))[:, None])


def read(file: str | os.PathLike[str]) -> Noise:
    """The noise in a YAML file. Raises NoiseError with FILE:LINE, OSError."""
    yaml = importlib.import_module("yaml")

    path = Path(file)
    try:
        root = yaml.compose(path.read_text(encoding="utf-8"), yaml.SafeLoader)
        given = _plain(root, str(path)) if root else _Map(str(path), 1)
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise NoiseError(f"{path}:{line}: is not valid YAML: {error.problem}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise NoiseError(f"{path}: is not YAML text") from error
    except RecursionError as error:
        raise NoiseError(f"{path}: is nested too deeply; a noise file has four "
                         "levels") from error
    return _noise(given, str(path))


def of(given: Mapping[str, Any]) -> Noise:
    """The noise in a dict with the keys of a noise file. Raises NoiseError."""
    return _noise(given, "noise")


class _Map(dict[str, Any]):
    """A mapping that knows its line and its keys' lines in a file."""

    def __init__(self, file: str, line: int) -> None:
        super().__init__()
        self.file, self.line = file, line
        self.lines: dict[str, int] = {}


_NUMBER = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")


def scalar_of(node: Any) -> Any:
    """The value of a YAML scalar, with numbers as the program reads them. Unlike YAML 1.1, 1e-3 is
    a number, and on and 2024-01-01 are words."""
    text = str(node.value)
    if node.style is not None:  # in quotes
        return text
    if _NUMBER.fullmatch(text):
        return int(text) if text.lstrip("+-").isdecimal() and len(text) < 300 else float(text)
    if text.lower().lstrip("+-") in (".nan", ".inf"):
        return float(text.replace(".", ""))
    return None if text in ("", "~", "null") else text


def _plain(node: Any, file: str) -> Any:
    """The value of a YAML node."""
    yaml = importlib.import_module("yaml")

    if isinstance(node, yaml.MappingNode):
        mapping = _Map(file, node.start_mark.line + 1)
        for key, value in node.value:
            line = key.start_mark.line + 1
            if not isinstance(key, yaml.ScalarNode):
                raise NoiseError(f"{file}:{line}: a key is not a word; keys are position, bias and "
                                 "the like")
            name = str(key.value)
            if name in mapping:
                raise NoiseError(f"{file}:{line}: '{name}' is there twice; leave one out")
            mapping[name], mapping.lines[name] = _plain(value, file), line
        return mapping
    if isinstance(node, yaml.SequenceNode):
        return [_plain(each, file) for each in node.value]
    return scalar_of(node)


def _at(of_keys: Mapping[str, Any], key: str, where: str) -> str:
    """FILE:LINE: a.b, for a key of the mapping `where`."""
    name = f"{where}.{key}" if where else key
    if isinstance(of_keys, _Map):
        return f"{of_keys.file}:{of_keys.lines.get(key, of_keys.line)}: {name}"
    return name


def _mapping(given: Mapping[str, Any], key: str, where: str, known: Iterable[str]) -> Any:
    """The mapping at a key; all its keys must be known."""
    value = given[key]
    name = f"{where}.{key}" if where else key
    words = ", ".join(known)
    if not isinstance(value, Mapping):
        raise NoiseError(f"{_at(given, key, where)} is {value!r}; it must be a mapping of {words}")
    _check_keys(value, name, known)
    return value


def _check_keys(given: Mapping[str, Any], where: str, known: Iterable[str]) -> None:
    words = sorted(known)
    for key in given:
        if key not in words:
            near = difflib.get_close_matches(str(key), words, n=1)
            raise NoiseError(f"{_at(given, str(key), where)} isn't known; "
                             + (f"did you mean '{near[0]}'?" if near else
                                "known are " + ", ".join(words)))


def _number(given: Mapping[str, Any], key: str, where: str, most: float,
            least: float = 0.0, item: int | None = None) -> float:
    """item: index in a list"""
    value = given[key] if item is None else given[key][item]
    if (isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating))
            or not least <= value <= most):
        raise NoiseError(f"{_at(given, key, where)} is {value!r}; it must be a number from "
                         f"{least:g} to {most:g}")
    return float(value)


def _numbers(given: Mapping[str, Any], key: str, where: str, most: float,
             axes: int) -> tuple[float, ...]:
    """One number per axis, or one for all."""
    value = given[key]
    if axes > 1 and isinstance(value, (Sequence, np.ndarray)) and not isinstance(value, str):
        if len(value) != axes:
            raise NoiseError(f"{_at(given, key, where)} has {len(value)} numbers; it must have "
                             f"one, or one for each of {', '.join(AXES)}")
        return tuple(_number(given, key, where, most, item=i) for i in range(axes))
    return (_number(given, key, where, most),) * axes


def _signal(given: Mapping[str, Any], where: str, most: float, axes: int) -> Signal:
    zero = (0.0,) * axes
    drift, tau = zero, 1.0
    if "drift" in given:
        of_drift = _mapping(given, "drift", where, ("sigma", "tau"))
        for key in ("sigma", "tau"):
            if key not in of_drift:
                raise NoiseError(f"{_at(given, 'drift', where)} has no {key}; sigma and tau are "
                                 "needed")
        drift = _numbers(of_drift, "sigma", f"{where}.drift", most, axes)
        tau = _number(of_drift, "tau", f"{where}.drift", 1e9, 1e-3)
    return Signal(_numbers(given, "bias", where, most, axes) if "bias" in given else zero, drift,
                  tau, _numbers(given, "white", where, most, axes) if "white" in given else zero)


def _joints(given: Mapping[str, Any]) -> tuple[Signal | None, dict[str, Signal]]:
    """The signal of all joints, and those of named joints."""
    if not isinstance(given["joints"], Mapping):
        raise NoiseError(f"{_at(given, 'joints', '')} is {given['joints']!r}; it must be a mapping "
                         f"of {', '.join(PARTS)}, or of joints to such mappings")
    joints = given["joints"]
    named = {}
    for name in joints:
        if name not in PARTS:
            near = difflib.get_close_matches(str(name), PARTS, n=1)
            if near and (not isinstance(joints[name], Mapping) or "sigma" in joints[name]):
                raise NoiseError(f"{_at(joints, name, 'joints')} isn't known; did you mean "
                                 f"'{near[0]}'?")
            one = _mapping(joints, name, "joints", PARTS)
            named[name] = _signal(one, f"joints.{name}", MOST["joint"], 1)
    everyone = any(part in joints for part in PARTS)
    return _signal(joints, "joints", MOST["joint"], 1) if everyone else None, named


def _terrain(given: Mapping[str, Any]) -> TerrainNoise:
    terrain = _mapping(given, "terrain", "", KEYS["terrain"])
    numbers = {key: _number(terrain, key, "terrain", MOST["terrain"])
               for key in ("bias", "white") if key in terrain}
    cell = _number(terrain, "cell", "terrain", 1e3, 1e-3) if "cell" in terrain else None
    if "correlated" in terrain:
        correlated = _mapping(terrain, "correlated", "terrain", ("sigma", "length"))
        for key in ("sigma", "length"):
            if key not in correlated:
                raise NoiseError(f"{_at(terrain, 'correlated', 'terrain')} has no {key}; sigma and "
                                 "length are needed")
        numbers["correlated"] = _number(correlated, "sigma", "terrain.correlated", MOST["terrain"])
        numbers["length"] = _number(correlated, "length", "terrain.correlated", 1e5, 1e-3)
    return TerrainNoise(**numbers, cell=cell)


def _noise(given: Any, where: str) -> Noise:
    if not isinstance(given, Mapping):
        raise NoiseError(f"{where}: is not a mapping; keys are {', '.join((*KEYS, 'joints'))}")
    if not given:
        raise NoiseError(f"{where}: is empty; an example is position: {{bias: 0.01}}")
    _check_keys(given, "", (*KEYS, "joints"))
    position, rotation = (
        _signal(_mapping(given, key, "", PARTS), key, MOST[key], 3) if key in given else None
        for key in ("position", "rotation"))
    bucket, soil = (
        {name: _number(value, name, key, POSITIVE.get(name, MOST[key])) for name in value}
        for key, value in ((key, _mapping(given, key, "", KEYS[key]) if key in given else {})
                           for key in ("bucket", "soil")))
    everyone, named = _joints(given) if "joints" in given else (None, {})
    terrain = _terrain(given) if "terrain" in given else TerrainNoise()
    return Noise(position, rotation, named, everyone, bucket, terrain, soil)
