# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Calls everything of the module with random arguments: it may raise, it may not crash, and a site
that refused something is as it was.

    python3 fuzz_arguments.py [SECONDS] [SEED]

Under sanitizers: tools/fuzz python SECONDS
"""

import math
import pickle
import random
import sys
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import soilvdb

ALLOWED = (ValueError, TypeError, RuntimeError, OverflowError, MemoryError, IndexError, KeyError,
           AttributeError, BufferError, pickle.PicklingError)

URDF = Path(__file__).parents[2] / "data/excavator.urdf"
JOINTS = ["swing_joint", "boom_joint", "arm_joint", "bucket_joint"]
HOME = np.array([0.0, 0.5, -1.5, 0.0])
LIP = np.array([[-1.0, 0, 0, 1.42], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])
LOAM = soilvdb.Soil(0.61, 0.25, 1800, 4000, 0.6)


class Chance:
    def __init__(self, seed):
        self.random = random.Random(seed)
        self.arrays = np.random.default_rng(seed)

    def number(self):
        return self.random.choice([
            0, 1, -1, 0.5, -0.3, 3, self.random.uniform(-5, 5), self.random.uniform(-1, 1), 1e-300,
            1e300, -1e9, math.nan, math.inf, -math.inf, 2**70, True, np.float32(0.3), np.int8(3)])

    def sane(self, count, most=2.0):
        return [self.random.uniform(-most, most) for _ in range(count)]

    def array(self):
        shape = self.random.choice([(3,), (4,), (0, 3), (5, 3), (5, 4), (5, 2), (4, 4), (5, 4, 4),
                                    (1, 1, 1), (), (7, 1)])
        kind = self.random.choice(["f8", "f4", "i4", ">f8", "?", "c16", "O", "U3", "M8[s]"])
        given = self.arrays.uniform(-2, 2, shape)
        if self.random.random() < 0.1:
            given = given * self.random.choice([math.nan, 1e12, 1e-12])
        try:
            with np.errstate(all="ignore"):
                given = np.asarray(given).astype(kind)
        except (TypeError, ValueError):
            pass
        if self.random.random() < 0.2 and given.ndim:
            given = given[::-1] if self.random.random() < 0.5 else np.asfortranarray(given)
        if self.random.random() < 0.2:
            given.setflags(write=False)
        return given

    def thing(self):
        return self.random.choice([
            self.number, self.number, self.array, self.array, lambda: self.sane(3),
            lambda: self.sane(4), lambda: tuple(self.sane(self.random.randrange(6))), lambda: None,
            lambda: "x", lambda: b"soilvdb state", lambda: [], lambda: {}, lambda: [None, "a"],
            lambda: [[1, 2], [3]], lambda: object(), lambda: "machine 0", lambda: 0,
            lambda: lambda: 1])()

    def rotation(self):
        angle = self.random.uniform(-2, 2)
        return (0.0, math.sin(angle / 2), 0.0, math.cos(angle / 2))

    def joints(self, rows=None):
        """As an array or by name, at times with one of no use."""
        values = HOME + self.arrays.uniform(-0.2, 0.2, (4,) if rows is None else (rows, 4))
        if self.random.random() < 0.5:
            return values
        named = {name: values[..., k] for k, name in enumerate(JOINTS)}
        if self.random.random() < 0.2:
            named[self.random.choice([*JOINTS, "bom_joint"])] = self.thing()
        if self.random.random() < 0.1:
            named.popitem()
        return named

    def base(self, rows=None):
        if self.random.random() < 0.2:
            return self.thing()
        shape = () if rows is None else (rows,)
        positions = self.arrays.uniform(-1, 1, (*shape, 3)) + BASE[:3, 3]
        if self.random.random() < 0.5:
            return positions, np.broadcast_to((0.0, 0.0, 0.6, 0.8), (*shape, 4))
        matrices = np.broadcast_to(BASE, (*shape, 4, 4)).copy()
        matrices[..., :3, 3] = positions
        return matrices

    def moves(self, site, rows=None):
        """A state of machine 0 that may be, or many."""
        keys = ("position", "rotation", "pose") if rows is None else ("positions", "rotations", "poses")
        if site.joints(0) and self.random.random() < 0.7:
            given = {"joints": self.joints(rows)}
            if self.random.random() < 0.5:
                given["base"] = self.base(rows)
            return given
        places = np.array([self.sane(3) for _ in range(rows or 1)])
        turns = np.array([self.rotation() for _ in range(rows or 1)])
        if self.random.random() < 0.3:
            matrices = np.tile(np.eye(4), (rows or 1, 1, 1))
            matrices[:, :3, 3] = places
            return {keys[2]: matrices[0] if rows is None else matrices}
        return {key: values[0] if rows is None else values
                for key, values in zip(keys, (places, turns))}

    def soil(self):
        strong = soilvdb.Soil(density=1800, friction_angle=0.5, cohesion=1000)
        return self.random.choice([LOAM, strong, strong, None, self.thing()])


def arm(base=None):
    bucket = soilvdb.Bucket(1.2, 0.9, [(0, 0), (-0.5, 0.0), (-0.9, 0.5), (0, 0.9)])
    return soilvdb.Machine(bucket, "machine 0", urdf=URDF, link="bucket_link", base=base, lip=LIP)


def standing():
    """Where the arm's base is if its lip is 0.2 m in the ground at HOME."""
    lip = soilvdb.Site(0.1, soilvdb.plane(0.0), [arm()]).pose(0, HOME)[0]
    base = np.eye(4)
    base[:3, 3] = (0, 0, -0.2) - lip
    return base


BASE = standing()


def make_site(chance):
    bucket = soilvdb.Bucket(1.2, 0.9, [(0, 0), (-0.5, 0.0), (-0.9, 0.5), (0, 0.9)])
    soil = LOAM if chance.random.random() < 0.5 else None
    machine = arm(BASE) if chance.random.random() < 0.5 else bucket
    pours = [soilvdb.Pour((0, 0, 3), 0.2, (0, 3))] if soil else []
    return soilvdb.Site(chance.random.choice([0.1, 0.2]), soilvdb.plane(0.0), [machine],
                        soil=soil, pours=pours)


def box(file):
    """A mesh of a box that is open on one side, 2 m x 1 m x 1 m."""
    corners = [(x, y, z) for x in (-1, 1) for y in (0, 1) for z in (0, 1)]
    faces = [(1, 2, 4, 3), (5, 6, 8, 7), (1, 3, 7, 5), (2, 4, 8, 6), (3, 4, 8, 7)]
    file.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) +
                    "".join(f"f {' '.join(map(str, face))}\n" for face in faces))
    return file


def step(chance, site, others):
    """One call, sensible or not."""
    pick = chance.random.random
    names = ["force", "mesh_bucket", "mesh_heights", "scan", "limits", "joints", "update", "update_path", "heights", "height_map", "maps", "mesh", "changed_patches", "ledger", "save",
             "restore", "clone", "pour", "come_to_rest", "change_m3", "pickle", "many", "vector",
             "volume", "pose", "place", "cast", "raster", "value", "close"]
    name = chance.random.choice(names)
    machine = 0 if pick() < 0.8 else chance.thing()
    if name == "update":
        if pick() < 0.5:
            return site.update(0, **chance.moves(site))
        keys = chance.random.sample(["position", "rotation", "pose", "joints", "base", "time", "speed"],
                                    chance.random.randrange(4))
        return site.update(machine, **{key: chance.thing() for key in keys})
    if name == "update_path":
        if pick() < 0.3:
            return site.update_path(0, **chance.moves(site, 3))
        keys = chance.random.sample(["positions", "rotations", "poses", "joints", "base", "times"],
                                    chance.random.randrange(4))
        return site.update_path(machine, **{key: chance.thing() for key in keys})
    if name == "heights":
        xy = chance.thing() if pick() < 0.5 else chance.arrays.uniform(-3, 3, (9, 2))
        return site.heights(xy, sigma=chance.random.choice([False, True, chance.thing()]),
                            ceiling=chance.random.choice([None, -0.2, chance.thing()]))
    if name == "mesh_heights":
        return site.mesh_heights(chance.thing() if pick() < 0.3 else
                                 chance.arrays.uniform(-3, 3, (9, 2)))
    if name == "force":
        soil = chance.soil()
        crescents = chance.random.choice([True, False]) if pick() < 0.8 else chance.thing()
        call = chance.random.choice([site.resistance, site.torques, lambda machine, **given:
                                     soilvdb.resistances([site, *others], machine, **given)])
        return call(machine, soil=soil, crescents=crescents)
    if name == "joints":
        return site.joints(machine), site.base(machine)
    if name == "limits":
        site.limits = chance.random.choice([True, True, False, chance.thing()])
        return site.limits
    if name == "mesh_bucket":
        with tempfile.TemporaryDirectory() as folder:
            file = box(Path(folder) / "box.obj") if pick() < 0.8 else chance.thing()
            given = {"lip": [(-1, 0, 0), (1, 0, 0)]}
            for key in chance.random.sample(["lip", "upper", "unit"], chance.random.randrange(3)):
                given[key] = chance.thing()
            if pick() < 0.5:
                return soilvdb.Bucket.pose_in_mesh(file, **given)
            if pick() < 0.3:
                given["dump_angle"] = chance.thing()
            return soilvdb.Bucket.from_mesh(file, **given)
    if name == "scan":
        given = {"position": (0, 0, 4), "rotation": (1, 0, 0, 0), "range_sigma": 0.01}
        for key in chance.random.sample(["position", "rotation", "pose", "name", "range_sigma", "noise",
                                         "range_squared_sigma", "mount_height_sigma",
                                         "mount_tilt_sigma"], chance.random.choice([0, 0, 1])):
            given[key] = chance.thing()
        sensor = soilvdb.Sensor(**given)
        seed = 1 if pick() < 0.7 else chance.thing()
        look = {"intrinsics": (3, 3, 1.5, 1.5) if pick() < 0.7 else chance.thing()}
        kind = chance.random.randrange(4)
        if kind == 0:
            shape = (4, 4) if pick() < 0.7 else chance.thing()
            image = soilvdb.depth_image(site, sensor, shape, look["intrinsics"], seed)
            return site.scan(sensor, depth=image if pick() < 0.7 else chance.thing(), **look)
        if kind == 1:
            beams = 3 if pick() < 0.7 else chance.thing()
            turn = soilvdb.lidar_turn(site, sensor, beams, 8 if pick() < 0.7 else chance.thing(), seed)
            return site.scan(sensor, turn)
        if kind == 2:
            return site.scan(sensor, chance.thing(), world=chance.random.choice([True, chance.thing()]))
        return site.apply_scans()
    if name in ("height_map", "maps"):
        given = {"shape": (4, 3), "cell": 0.1, "origin": (0.0, 0.0)}
        if pick() < 0.5:
            del given["origin"]
            given["machine"] = machine
        for key in chance.random.sample(["machine", "origin", "pose", "shape", "cell", "turned",
                                         "layer", "ceiling", "design", "out"], chance.random.randrange(4)):
            given[key] = chance.thing()
        if name == "maps":
            return soilvdb.height_maps(others if pick() < 0.8 else chance.thing(), **given)
        return site.height_map(**given)
    if name == "restore":
        state = site.save()
        if pick() < 0.3:
            return site.restore(state)
        at = chance.random.randrange(len(state))
        return site.restore(chance.random.choice(
            [state[:at], state[:at] + b"x" + state[at + 1:], state + state, chance.thing()]))
    if name == "clone":
        others.append(site.clone())
        return None
    if name == "pour":
        return site.pour(chance.thing())
    if name == "ledger":
        return site.ledger(chance.thing())
    if name == "pickle":
        return pickle.loads(pickle.dumps(site))
    if name == "many":
        sites = others if pick() < 0.8 else chance.thing()
        if pick() < 0.6 and others:
            return soilvdb.update_many(sites, machine, **chance.moves(site, len(others)))
        keys = chance.random.sample(["positions", "rotations", "poses", "joints", "base", "times",
                                     "time"], 2)
        return soilvdb.update_many(sites, machine, **{key: chance.thing() for key in keys})
    if name == "vector":
        env = soilvdb.VectorSite(site, 2)
        keys = chance.random.sample(["positions", "rotations", "poses", "joints", "times"],
                                    chance.random.randrange(3))
        given = {key: chance.thing() for key in keys} if pick() < 0.3 else chance.moves(site, 2)
        machine = 0 if pick() < 0.8 else machine
        which = chance.random.choice([None, [True, False], [1], chance.thing()])
        if pick() < 0.3:
            env.reset(which, chance.random.choice([None, site, site.save(), chance.thing()]))
        if pick() < 0.1:
            env.randomise([1], repose_angle=0.5, z=[chance.random.uniform(-1, 1)])
        elif pick() < 0.2:
            env.randomise(which, **{key: chance.thing() for key in chance.random.sample(
                ["repose_angle", "swell", "density", "cohesion", "z", "slope", "heights", "origin",
                 "cell"], 2)})
        steps = env.step(machine, **given)
        assert (steps.status == 0).sum() + len(steps.errors) == 2
        look = {"shape": (3, 4), "cell": 0.2, "machine": machine}
        for key in chance.random.sample(["machine", "origin", "pose", "turned", "layer", "ceiling",
                                         "design", "out"], chance.random.choice([0, 0, 1, 2])):
            look[key] = chance.thing()
        return chance.random.choice([
            lambda: env.height_map(**look), lambda: env.loads(machine),
            lambda: env.resistance(machine, soil=chance.soil())])()
    if name == "volume":
        return site.volume(chance.arrays.uniform(-3, 3, (3, 2)) if pick() < 0.5 else chance.thing(),
                           design=soilvdb.plane(-0.2) if pick() < 0.5 else chance.thing())
    if name == "place":
        if pick() < 0.7:
            return site.place(0, **chance.moves(site))
        return site.place(machine, position=chance.thing(), time=chance.thing())
    if name == "cast":
        return site.cast(chance.sane(3) if pick() < 0.6 else chance.thing(),
                         chance.arrays.normal(size=(2, 3, 3)) if pick() < 0.6 else chance.thing())
    if name == "pose":
        if pick() < 0.7:
            rows = chance.random.choice([None, 3])
            return site.pose(0, chance.joints(rows), chance.base(rows) if pick() < 0.5 else None)
        return site.pose(machine, chance.thing(), chance.thing())
    if name == "raster":
        return soilvdb.Site(0.2, soilvdb.raster(
            chance.arrays.uniform(-3, 3, (4, 5)) if pick() < 0.5 else chance.thing(),
            origin=(0, 0) if pick() < 0.7 else chance.thing(),
            cell=0.5 if pick() < 0.7 else chance.thing()), [soilvdb.Bucket(1, 1)])
    if name == "value":
        kind = chance.random.choice([soilvdb.Bucket, soilvdb.Soil, soilvdb.Pour, soilvdb.Hopper,
                                     soilvdb.Machine, soilvdb.plane, soilvdb.raster,
                                     soilvdb.snapshot, soilvdb.Site])
        return kind(*[chance.thing() for _ in range(chance.random.randrange(5))])
    if name == "close":
        return site.close() if pick() < 0.05 else None
    return getattr(site, name)() if hasattr(site, name) else None


def main():
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else random.randrange(2**32)
    print("seed", seed, flush=True)
    warnings.filterwarnings("ignore", "machine .* moved backwards")  # as random ones do
    chance, end = Chance(seed), time.monotonic() + seconds
    calls = refused = 0
    while time.monotonic() < end:
        site, others = make_site(chance), []
        for _ in range(60):
            before, number = None, chance.random.getstate()
            if chance.random.random() < 0.1:
                try:
                    before = site.save()
                except RuntimeError:
                    break
            chance.random.setstate(number)
            calls += 1
            try:
                step(chance, site, others)
            except ALLOWED as error:
                refused += 1
                text = str(error)
                assert text and "\n" not in text, repr(error)
                path = "state " in text and "state 0" not in text  # some of it had moved
                if before is not None and not path and "closed" not in text:
                    assert site.save() == before, f"{error!r} left a trace"
            del others[4:]
    print(f"{calls} calls, {refused} refused")
    assert refused > calls // 10


if __name__ == "__main__":
    main()
