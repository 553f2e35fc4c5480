# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Digs realisations of a scenario: draws of its noise, each on a site of its own."""

from __future__ import annotations

import copy
import csv
import dataclasses
import importlib
import math
import os
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import soilvdb
from soilvdb.noise import Draw, Floats, Noise, NoiseError, scalar_of, turned

from . import InputError, nearest

BASE = tuple(f"soilvdb_base_{name}" for name in ("x", "y", "z", "roll", "pitch", "yaw"))
MARGIN_M = 10.0  # of ground with an error of its own around where machines come
MOST_POSTS = 4e6
NAMED_ROWS = 200  # of a motion, that say where a site is
SOIL_KEYS = {"repose": "repose_angle"}  # keys of a scenario's soil where a noise file has others
SOIL_DEFAULTS = {"density": 1800.0, "adhesion": 0.0}
TEXTS = ("name", "raster", "level_set", "grid", "motion", "mcap", "topic", "frame", "parent",
         "angles", "bad_rows", "urdf", "link")  # keys whose values are no numbers, though they look it


@dataclasses.dataclass(frozen=True)
class Study:
    """The inputs of draws, for workers. Draws depend on nothing else."""

    scenario: str
    noise: Noise
    seed: int
    noise_file: str = "noise"  # in messages


@dataclasses.dataclass
class Dug:
    """The result of one draw, by machine name."""

    load_m3: dict[str, Floats]  # after each of its rows
    cut_m3: dict[str, Floats]  # by then, in place
    fill_m3: float  # added to the ground
    site: soilvdb.Site
    waited: int  # rows that were left out, at ground without a height
    # After each of its rows, (rows, 4): force x, y, z, N, and moment y, N m, in the bucket's frame;
    # NaN before its first state. Empty where the scenario doesn't ask for forces.
    force: dict[str, Floats]


class Scene:
    """A scenario, read once, and its sites."""

    def __init__(self, study: Study) -> None:
        yaml = importlib.import_module("yaml")
        self.study, self._file = study, Path(study.scenario)
        try:
            self.motions = soilvdb.motions(self._file)
            self.nominal = soilvdb.Site.open(self._file, limits=False)
        except ValueError as error:
            raise InputError(str(error)) from error
        self._values: dict[str, Any] = values_of(
            yaml.compose(self._file.read_text(encoding="utf-8"), yaml.SafeLoader))
        self._machines: list[dict[str, Any]] = self._values.get("machines") or []
        self.names = [name for name in self.nominal.machines if name in self.motions]
        asked = (self._values.get("output") or {}).get("force") == "true"
        self.blades = [machine["name"] for machine in self._machines
                       if asked and machine["name"] in self.names]
        self._joints = {name: self.nominal.joints(name) for name in self.names}
        self._dump = yaml.safe_dump
        self._check()
        self.inputs_were = self.inputs_are()
        self._folder = tempfile.TemporaryDirectory(prefix="soilvdb-")
        self._order = list(self._rows_in_order())
        if self.blades:  # a force after each row
            self._order = _single(self._order)
        sources = study.noise.sources()
        # Of machines that drive, the rows have the base, to which its errors are added.
        self._floats = ({name for name, joints in self._joints.items()
                         if joints and "base" not in self.motions[name]}
                        if study.noise.moves_base() else set())
        self._each_opened = any(s.startswith(("bucket.", "terrain.", "soil.")) for s in sources)
        self._undug = self._open(None) if self._floats else self.nominal.clone()
        self.end_s = max([m["times"][-1] for m in self.motions.values()]
                         + [pour["time"][1] for pour in self._values.get("pours") or []])

    def _check(self) -> None:
        """Refuses noise that the scenario has no use for."""
        noise, file = self.study.noise, self._file
        if not self.names:
            raise InputError(f"{file}: no machine has a motion; noise needs at least one")
        for machine in self._machines:
            if "bucket" not in machine:
                raise InputError(f"{file}: machine '{machine['name']}' has a closed tool; a study "
                                 "knows buckets only")
        joints = sorted({joint for names in self._joints.values() for joint in names})
        for joint in noise.joints:
            if joint not in joints:
                self._refuse(f"joints.{joint}: no machine has that joint; "
                             + (nearest(joint, joints) if joints else "none has any"))
        if noise.all_joints and not joints:
            self._refuse("joints: no machine has any; leave them out")
        soil = self._values.get("soil")
        if noise.soil and soil is None:
            self._refuse("soil: doesn't move in the scenario; leave it out")
        if noise.soil.get("swell") and not (soil or {}).get("swell"):
            self._refuse("soil.swell: soil doesn't swell in the scenario; leave it out")
        if soil is not None:
            self._check_strength(soil)
        for machine in self._machines:
            for key, sigma in noise.bucket.items():
                if sigma > machine["bucket"][key] / 5:
                    self._refuse(f"bucket.{key} is {sigma:g}, which is more than a fifth of that of "
                                 f"'{machine['name']}', {machine['bucket'][key]:g} m")
        if noise.terrain.parts() and "level_set" in self._values["terrain"]:
            self._refuse("terrain: needs a plane or a raster; the scenario has a level set")
        if noise.terrain.white and noise.terrain.cell is None and "plane" in self._values["terrain"]:
            self._refuse("terrain.white: a plane has no heights of its own; give their spacing, "
                         "such as cell: 0.5")
        if noise.terrain.parts() and "plane" in self._values["terrain"]:
            if noise.terrain.correlated and (noise.terrain.cell or 0.0) > noise.terrain.length:
                self._refuse(f"terrain.cell is {noise.terrain.cell:g}; it must be at most "
                             f"correlated.length, {noise.terrain.length:g} m")
            self._posts_of_plane(self.box())

    def _check_strength(self, soil: dict[str, Any]) -> None:
        noise = self.study.noise
        try:
            noise.check_strength(SOIL_DEFAULTS | soil)
        except NoiseError as error:
            self._refuse(str(error))
        digs = () if soil.get("cohesion") is None else ("density", "cohesion", "friction_angle")
        for key in noise.strength():
            if not self.blades and key not in digs:
                self._refuse(f"soil.{key}: changes forces only, and the scenario has no output: "
                             "{force: true}; leave it out")

    def _refuse(self, why: str) -> NoReturn:
        raise InputError(f"{self.study.noise_file}: {why}")

    def _rows_in_order(self) -> Iterator[tuple[str, int, int]]:
        """The order of the machines' rows in a run: (name, begin, end)."""
        times = np.concatenate([self.motions[name]["times"] for name in self.names])
        machine = np.repeat(range(len(self.names)),
                            [len(self.motions[name]["times"]) for name in self.names])
        machine = machine[np.lexsort((machine, times))]
        done = [0] * len(self.names)
        ends = np.append(np.flatnonzero(np.diff(machine)), len(machine) - 1)
        at = 0
        for end in ends:
            who, count = int(machine[at]), int(end) + 1 - at
            yield self.names[who], done[who], done[who] + count
            done[who] += count
            at = int(end) + 1

    def _perturbed(self, draw: Draw | None) -> dict[str, dict[str, Floats]]:
        """The rows of each machine with a draw's errors, for update_path()."""
        rows = {}
        for name in self.names:
            given = dict(self.motions[name])
            times = given["times"]
            position, rotation = (draw.base(name, times) if draw else
                                  (np.zeros((len(times), 3)), np.zeros((len(times), 3))))
            if "joints" in given:
                joints = given["joints"]
                if draw:
                    joints = joints + draw.joints(name, times, self._joints[name])
                if name in self._floats:
                    joints = np.hstack([position @ self._world_from_base(name), rotation, joints])
                given["joints"] = joints
                if "base" in given and draw:
                    given["base"] = (given["base"][0] + position,
                                     turned(given["base"][1], rotation))
            elif draw:
                given["positions"] = given["positions"] + position
                given["rotations"] = turned(given["rotations"], rotation)
            rows[name] = given
        return rows

    def _world_from_base(self, name: str) -> Floats:
        """Rotation (3, 3) of a machine's base, about fixed x, y, z as in URDF."""
        machine = next(m for m in self._machines if m["name"] == name)
        roll, pitch, yaw = (machine.get("base") or {}).get("rpy", (0.0, 0.0, 0.0))
        (a, b), (c, d), (e, f) = ((math.cos(t), math.sin(t)) for t in (roll, pitch, yaw))
        return np.array([[e * c, e * d * b - f * a, e * d * a + f * b],
                         [f * c, f * d * b + e * a, f * d * a - e * b], [-d, c * b, c * a]])

    def _open(self, draw: Draw | None) -> soilvdb.Site:
        """A site of the scenario with a draw's buckets, terrain and soil."""
        values = copy.deepcopy(self._values)
        values.pop("output", None)
        folder = Path(self._folder.name)
        beside = self._file.resolve().parent
        terrain = values["terrain"]
        for key in ("raster", "level_set"):
            if key in terrain:
                terrain[key] = str(beside / terrain[key])
        for machine in values["machines"]:
            for key in ("motion", "angles", "bad_rows"):
                machine.pop(key, None)
            if "urdf" in machine:
                machine["urdf"] = str(self._floating(beside / machine["urdf"], machine["name"])
                                      if machine["name"] in self._floats
                                      else beside / machine["urdf"])
            for key, sigma in self.study.noise.bucket.items():
                half = machine["bucket"][key] / 2
                if draw:
                    self._resize(machine["bucket"], key, draw.scalar(f"bucket.{key}", sigma, -half,
                                                                     half, machine["name"]))
        if draw:
            for key, sigma in self.study.noise.soil.items():
                name = SOIL_KEYS.get(key, key)
                if sigma:
                    values["soil"][name] = draw.soil(
                        key, values["soil"].get(name, SOIL_DEFAULTS.get(name)))
            if self.study.noise.terrain.parts():
                self._write_terrain(draw, values, folder / "terrain.tif")
        first = next(m for m in values["machines"] if m["name"] == self.names[0])
        first["motion"], first["bad_rows"] = "where.csv", "skip"
        self._write_where(self.names[0], folder / "where.csv")
        scenario = folder / "draw.yaml"
        scenario.write_text(self._dump(values), encoding="utf-8")
        try:
            return soilvdb.Site.open(scenario, limits=False)
        except ValueError as error:
            raise RuntimeError(f"{self._file}: as it was drawn: {error}") from error

    @staticmethod
    def _resize(bucket: dict[str, Any], key: str, error: float) -> None:
        """Scales the bucket's profile with it, from lip to upper edge."""
        scale = 1 + error / bucket[key]
        bucket[key] += error
        if key == "height" and "profile" in bucket:
            bucket["profile"] = [[x, z * scale] for x, z in bucket["profile"]]
            bucket["profile"][-1][1] = bucket["height"]

    def _floating(self, urdf: Path, name: str) -> Path:
        """The URDF with six more joints at its root, for errors of the base."""
        try:
            tree = ElementTree.parse(urdf)
        except ElementTree.ParseError as error:  # of namespaces, which the program doesn't look at
            raise InputError(f"{urdf}: isn't well-formed XML: {error}; an error of the base is put "
                             "into the URDF, which takes one that is") from error
        robot = tree.getroot()
        children = {joint.find("child").get("link")  # type: ignore[union-attr]
                    for joint in robot.findall("joint")}
        root = next(link.get("name", "") for link in robot.findall("link")
                    if link.get("name") not in children)
        for link in BASE:
            ElementTree.SubElement(robot, "link", name=f"{link}_link")
        axes = ("1 0 0", "0 1 0", "0 0 1")
        ends = [*(f"{link}_link" for link in BASE), root]
        for i, joint in enumerate(BASE):
            element = ElementTree.SubElement(robot, "joint", name=joint,
                                             type="prismatic" if i < 3 else "continuous")
            ElementTree.SubElement(element, "parent", link=ends[i])
            ElementTree.SubElement(element, "child", link=ends[i + 1])
            ElementTree.SubElement(element, "axis", xyz=axes[i % 3])
            if i < 3:
                ElementTree.SubElement(element, "limit", lower="-1e3", upper="1e3", effort="0",
                                       velocity="1e3")
        file = Path(self._folder.name) / f"{self.nominal.machines.index(name)}.urdf"
        tree.write(file)
        return file

    def _write_where(self, name: str, file: Path) -> None:
        """Writes some rows of a motion, from which a site takes its origin."""
        rows = self._perturbed(None)[name]
        columns = [rows["times"][:, None]]
        if "joints" in rows:
            columns.append(rows["joints"])
            header = ["time", *(BASE if name in self._floats else ()), *self._joints[name]]
            if "base" in rows:
                columns += rows["base"]
                header += [f"base_{axis}" for axis in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        else:
            columns += [rows["positions"], rows["rotations"]]
            header = ["time", "x", "y", "z", "qx", "qy", "qz", "qw"]
        table = np.hstack(columns)
        with open(file, "w", newline="", encoding="utf-8") as text:
            writer = csv.writer(text)
            writer.writerow(header)
            writer.writerows(table[::-(-len(table) // NAMED_ROWS)].tolist())

    def crs(self) -> str:
        """CRS of the terrain, WKT; empty: unknown."""
        raster = self._values["terrain"].get("raster")
        if raster is None:
            return ""
        at = self.places()[0]
        return soilvdb.read_raster(self._file.resolve().parent / raster, (*at, *at))[3]

    def places(self) -> Floats:
        """(N, 2) of all bucket frames of the recorded motions, m."""
        places = []
        for name in self.names:
            rows = self.motions[name]
            at = (self.nominal.pose(name, rows["joints"], rows.get("base"))[0] if "joints" in rows
                  else rows["positions"])
            places.append(at[:, :2])
        return np.concatenate(places)

    def spare_m(self) -> float:
        """Largest expected distance of a draw's positions from the recorded ones, m."""
        errs = self.study.noise.position
        return 6 * math.hypot(*errs.bias, *errs.drift, *errs.white) if errs else 0.0

    def box(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the ground that may matter, m."""
        at = self.places()
        boxes = [[*at.min(axis=0), *at.max(axis=0)]]
        boxes += [[*pour["at"][:2], *pour["at"][:2]] for pour in self._values.get("pours") or []]
        boxes += [hopper["box"] for hopper in self._values.get("hoppers") or []]
        all_of_them = np.array(boxes, dtype=float)
        reach = max(2.0 * machine["bucket"]["width"] + 2.0 * machine["bucket"]["height"]
                    for machine in self._machines) + self.spare_m()
        low, high = all_of_them[:, :2].min(axis=0), all_of_them[:, 2:].max(axis=0)
        low, high = low - reach - MARGIN_M, high + reach + MARGIN_M
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def _posts_of_plane(self, box: tuple[float, float, float, float]) -> tuple[float, list[int]]:
        """Spacing and number (nx, ny) of a plane's heights.

        Linear interpolation reduces correlated errors for small loads: by 5 % of sigma for a
        spacing of a quarter of the correlation length, by 1 % for a tenth.
        """
        noise, size = self.study.noise.terrain, (box[2] - box[0], box[3] - box[1])
        if noise.cell or not noise.length:
            cell = noise.cell or max(size)
        else:
            affordable = math.sqrt(2 * size[0] * size[1] / MOST_POSTS)
            cell = min(noise.length / 4, max(noise.length / 10, affordable))
        count = [max(2, math.ceil(size[i] / cell) + 1) for i in (0, 1)]
        if count[0] * count[1] > MOST_POSTS:
            key = "cell" if noise.cell else "correlated.length"
            self._refuse(f"terrain.{key}: takes {count[0]} x {count[1]} heights of the "
                         f"{size[0]:.0f} x {size[1]:.0f} m where machines come; a larger one would do")
        return cell, count

    def _write_terrain(self, draw: Draw, values: dict[str, Any], file: Path) -> None:
        """Writes heights with a draw's errors, in the machines' area, in place of the scenario's
        terrain."""
        noise, box = self.study.noise.terrain, self.box()
        crs = ""
        if "raster" in values["terrain"]:
            heights, first, spacing, crs = soilvdb.read_raster(values["terrain"]["raster"], box)
            posts = np.asarray(heights, dtype=float)
        else:
            cell, count = self._posts_of_plane(box)
            first, spacing = (box[0], box[1]), (cell, cell)
            plane = values["terrain"]["plane"]
            slope = plane.get("slope", (0.0, 0.0))
            x = box[0] + cell * np.arange(count[0])
            y = box[1] + cell * np.arange(count[1])
            posts = plane.get("z", 0.0) + slope[0] * x[None, :] + slope[1] * y[:, None]
        errors = draw.terrain((posts.shape[0], posts.shape[1]), spacing)
        soilvdb.write_raster(file, posts + errors, first, spacing, crs)
        values["terrain"] = {"raster": str(file)}

    def dig(self, draw: Draw | None) -> Dug:
        """Digs the whole scenario with a draw's errors; without a draw, as recorded. At ground
        without a height a draw's machine waits for the next row.

        Raises RuntimeError if a machine's state is impossible.
        """
        try:
            return self._dig(draw, self._order)
        except soilvdb.NoGroundError as error:
            if draw is None:
                raise RuntimeError(f"{self._file}: {error}") from error
        return self._dig(draw, _single(self._order), waits=True)

    def _dig(self, draw: Draw | None, order: Iterable[tuple[str, int, int]],
             waits: bool = False) -> Dug:
        opened = draw is not None and self._each_opened
        site = self._open(draw) if opened else self._undug.clone()
        rows = self._perturbed(draw)
        load = {name: np.zeros(len(rows[name]["times"])) for name in self.names}
        cut = {name: np.zeros(len(rows[name]["times"])) for name in self.names}
        force = {name: np.full((len(rows[name]["times"]), 4), np.nan) for name in self.blades}
        waited = 0
        for name, begin, end in order:
            part: Any = {key: (tuple(each[begin:end] for each in values) if key == "base"
                               else values[begin:end]) for key, values in rows[name].items()}
            try:
                updates = site.update_path(name, **part)
            except soilvdb.NoGroundError:
                if not waits:
                    raise
                waited += 1
                load[name][begin] = load[name][begin - 1] if begin else 0.0
                if name in force and begin:
                    force[name][begin] = force[name][begin - 1]
                continue
            except ValueError as error:
                raise RuntimeError(f"{self._file}: machine '{name}', drawn from {end - begin} rows "
                                   f"on from {part['times'][0]:g} s: {error}") from error
            load[name][begin:end] = updates["bucket_m3"]
            cut[name][begin:end] = updates["cut_m3"]
            if name in force:
                felt = site.resistance(name)
                force[name][begin] = (*felt.force, felt.moment[1])
        site.pour(self.end_s)
        site.come_to_rest()
        return Dug(load, {name: np.cumsum(c) for name, c in cut.items()},
                   site.ledger()["fill_m3"], site, waited, force)

    def inputs_are(self) -> list[tuple[str, int, int]]:
        """The present state of the input files: name, time, size."""
        terrain = self._values["terrain"]
        names = [terrain[key] for key in ("raster", "level_set") if key in terrain]
        for machine in self._machines:
            motion = machine.get("motion")
            files_of = motion["mcap"] if isinstance(motion, dict) else motion
            names += files_of if isinstance(files_of, list) else [files_of]
            names.append(machine.get("urdf"))
        beside = self._file.resolve().parent
        files = [str(self._file)]
        for path in (beside / name for name in names if name):
            files += map(str, sorted(path.glob("*.mcap")) if path.is_dir() else [path])
        return [(file, stat.st_mtime_ns, stat.st_size)
                for file, stat in ((file, os.stat(file)) for file in files)]


def _single(order: Iterable[tuple[str, int, int]]) -> list[tuple[str, int, int]]:
    """The same order, row by row."""
    return [(name, row, row + 1) for name, begin, end in order for row in range(begin, end)]


def values_of(node: Any, key: str = "") -> Any:
    """The value of a scenario's YAML node, as the program reads it; aliases are copied."""
    yaml = importlib.import_module("yaml")

    if isinstance(node, yaml.MappingNode):
        return {name.value: values_of(value, name.value) for name, value in node.value}
    if isinstance(node, yaml.SequenceNode):
        return [values_of(each, key) for each in node.value]
    return node.value if key in TEXTS else scalar_of(node)


def scene_of(study: Study) -> Scene:
    """The scene of a study, cached in this process while its files do not change."""
    scene: Scene | None = _LAST.get("scene")
    if scene is None or scene.study != study or scene.inputs_are() != scene.inputs_were:
        scene = _LAST["scene"] = Scene(study)
    return scene


_LAST: dict[str, Scene] = {}
