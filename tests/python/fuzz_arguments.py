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
import time
import warnings

import numpy as np

import soilvdb

ALLOWED = (ValueError, TypeError, RuntimeError, OverflowError, MemoryError, IndexError, KeyError,
           AttributeError, BufferError, pickle.PicklingError)


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


def make_site(chance):
    bucket = soilvdb.Bucket(1.2, 0.9, [(0, 0), (-0.5, 0.0), (-0.9, 0.5), (0, 0.9)])
    soil = soilvdb.Soil(0.61, 0.25, 1800, 4000) if chance.random.random() < 0.5 else None
    pours = [soilvdb.Pour((0, 0, 3), 0.2, (0, 3))] if soil else []
    return soilvdb.Site(chance.random.choice([0.1, 0.2]), soilvdb.plane(0.0), [bucket], soil=soil,
                        pours=pours)


def step(chance, site, others):
    """One call, sensible or not."""
    pick = chance.random.random
    names = ["update", "update_path", "heights", "height_map", "maps", "mesh", "changed_patches", "ledger", "save",
             "restore", "clone", "pour", "come_to_rest", "change_m3", "pickle", "many", "vector",
             "volume", "pose", "place", "cast", "raster", "value", "close"]
    name = chance.random.choice(names)
    machine = 0 if pick() < 0.8 else chance.thing()
    if name == "update":
        if pick() < 0.5:
            return site.update(0, position=chance.sane(3), rotation=chance.rotation())
        keys = chance.random.sample(["position", "rotation", "pose", "joints", "time", "speed"],
                                    chance.random.randrange(4))
        return site.update(machine, **{key: chance.thing() for key in keys})
    if name == "update_path":
        if pick() < 0.3:
            return site.update_path(0, positions=[chance.sane(3) for _ in range(3)])
        keys = chance.random.sample(["positions", "rotations", "poses", "joints", "times"],
                                    chance.random.randrange(4))
        return site.update_path(machine, **{key: chance.thing() for key in keys})
    if name == "heights":
        return site.heights(chance.thing() if pick() < 0.5 else chance.arrays.uniform(-3, 3, (9, 2)))
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
        at = [chance.sane(3) for _ in others] if pick() < 0.6 else chance.thing()
        return soilvdb.update_many(sites, machine, positions=at)
    if name == "vector":
        env = soilvdb.VectorSite(site, 2)
        keys = chance.random.sample(["positions", "rotations", "poses", "joints", "times"],
                                    chance.random.randrange(3))
        given = {key: chance.thing() for key in keys} if pick() < 0.5 else {
            "positions": [chance.sane(3), chance.sane(3)]}
        which = chance.random.choice([None, [True, False], [1], chance.thing()])
        if pick() < 0.3:
            env.reset(which, chance.random.choice([None, site, site.save(), chance.thing()]))
        if pick() < 0.3:
            env.randomise(which, **{key: chance.thing() for key in chance.random.sample(
                ["repose_angle", "swell", "density", "cohesion", "z", "slope", "heights", "origin",
                 "cell"], 2)})
        return env.step(machine, **given)
    if name == "volume":
        return site.volume(chance.arrays.uniform(-3, 3, (3, 2)) if pick() < 0.5 else chance.thing(),
                           design=soilvdb.plane(-0.2) if pick() < 0.5 else chance.thing())
    if name == "place":
        if pick() < 0.5:
            return site.place(0, position=chance.sane(3), rotation=chance.rotation())
        return site.place(machine, position=chance.thing(), time=chance.thing())
    if name == "cast":
        return site.cast(chance.sane(3) if pick() < 0.6 else chance.thing(),
                         chance.arrays.normal(size=(2, 3, 3)) if pick() < 0.6 else chance.thing())
    if name == "pose":
        return site.pose(machine, chance.thing())
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
    if name == "close" and pick() < 0.02:
        return site.close()
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
