# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many sites in one call are those sites one by one; one that is refused fails alone."""

import ctypes
import os
import pickle
import signal
import warnings

import numpy as np
import pytest

import soilvdb

PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
LOAM = soilvdb.Soil(repose_angle=0.61, swell=0.25)
COUNT = 5


@pytest.fixture(params=[None, LOAM], ids=["rigid", "moving"])
def start(request):
    return soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)],
                        soil=request.param)


def paths(steps=20, seed=3):
    """Positions (steps, COUNT, 3) of random drags, and rotations."""
    random = np.random.default_rng(seed)
    s = np.linspace(0, 1, steps)[:, None]
    depth, way = random.uniform(0.1, 0.5, COUNT), random.uniform(1, 4, COUNT)
    positions = np.stack([way * s, 0 * way + 0 * s, 0.1 - (depth + 0.1) * np.sin(np.pi * s)], 2)
    pitch = random.uniform(-0.3, 0.4, COUNT) * s
    zero = np.zeros_like(pitch)
    return positions, np.stack([zero, np.sin(pitch / 2), zero, np.cos(pitch / 2)], 2)


def test_sites_are_those_stepped_alone_on_any_number_of_threads(start):
    positions, rotations = paths()
    vectors = [soilvdb.VectorSite(start, COUNT, threads=threads) for threads in (None, 1, 2)]
    alone = [start.clone() for _ in range(COUNT)]
    for n, (p, q) in enumerate(zip(positions, rotations)):
        one_by_one = [site.update(0, position=p[i], rotation=q[i], time=n)
                      for i, site in enumerate(alone)]
        for env in vectors:
            steps = env.step(0, positions=p, rotations=q, times=n)
            assert (steps.status == 0).all() and not steps.errors
            for name in ("cut_m3", "bucket_m3", "spilled_m3", "slid_m3"):
                assert (getattr(steps, name) == [getattr(u, name) for u in one_by_one]).all()
    maps = soilvdb.height_maps(alone, machine=0, shape=(6, 8), cell=0.2)
    assert steps.bucket_m3.max() > 0.1
    for env in vectors:
        assert [s.save() for s in env.sites] == [s.save() for s in alone]
        assert (env.height_map(machine="machine 0", shape=(6, 8), cell=0.2) == maps).all()
        assert (env.loads(0) == steps.bucket_m3).all()
    again = pickle.loads(pickle.dumps(vectors[0]))
    assert [s.save() for s in again.sites] == [s.save() for s in alone]


def test_a_bad_state_fails_alone_and_says_why(start):
    env = soilvdb.VectorSite(start, COUNT)
    positions, _ = paths()
    env.step(0, positions=positions[0])
    for p in positions[1:9]:
        held = env.step(0, positions=p)
    before = [site.save() for site in env.sites]
    bad = positions[9].copy()
    bad[1, 2] = np.nan
    bad[3, 0] += 200
    steps = env.step(0, positions=bad)
    assert steps.status.tolist() == [0, 1, 0, 1, 0]
    assert list(steps.errors) == [1, 3]
    for i, error in steps.errors.items():
        assert isinstance(error, soilvdb.StateError) and error.machine == "machine 0"
        assert str(error).startswith(f"site {i}: machine 'machine 0'")
        assert str(error).endswith(error.reason)
        assert steps.cut_m3[i] == 0 and steps.bucket_m3[i] == held.bucket_m3[i] > 0
    assert "200" in steps.errors[3].reason and "finite" in steps.errors[1].reason
    now = [site.save() for site in env.sites]
    assert [a == b for a, b in zip(now, before)] == [False, True, False, True, False]
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, :3, 3] = positions[9]
    matrices[4, 0, 0] = 3
    steps = env.step(0, poses=matrices)
    assert steps.status.tolist() == [0, 0, 0, 0, 1]
    assert str(steps.errors[4]).startswith("site 4: machine 'machine 0': pose is not a rigid")
    for bad in (np.nan, np.inf):
        steps = env.step(0, positions=positions[10], times=[1, bad, 1, 1, 1])
        assert steps.status.tolist() == [0, 1, 0, 0, 0]
        assert isinstance(steps.errors[1], soilvdb.StateError) and "time" in steps.errors[1].reason
        assert steps.errors[1].machine == "machine 0"


def test_ground_that_ends_is_another_status():
    flat = soilvdb.raster(np.zeros((13, 13)), origin=(-6, -6), cell=1.0)
    env = soilvdb.VectorSite(soilvdb.Site(0.1, flat, [soilvdb.Bucket(1.2, 0.9)]), 2)
    env.step(0, positions=[(4, 0, -0.2)] * 2)
    steps = env.step(0, positions=[(9, 0, -0.2), (4.5, 0, -0.2)])
    assert steps.status.tolist() == [2, 0]
    assert isinstance(steps.errors[0], soilvdb.NoGroundError)
    assert steps.cut_m3[1] > 0


def test_sites_begin_anew_as_they_are_told(start):
    positions, _ = paths()
    env = soilvdb.VectorSite(start, COUNT)
    dug = start.clone()
    dug.update_path(0, positions=positions[:, 0])
    for p in positions[:10]:
        env.step(0, positions=p)
    moved = [site.save() for site in env.sites]
    env.reset([True, False, False, False, True], states=[dug, dug.save()])
    assert env.sites[0].save() == env.sites[4].save() == dug.save()
    assert [s.save() for s in env.sites[1:4]] == moved[1:4]
    env.reset(np.array([2]))
    assert env.sites[2].save() == start.save()
    env.step(0, positions=positions[0] + (0, 5, 0))
    assert dug.save() != env.sites[0].save()  # a pool's states stay
    env.reset(states=dug)
    env.reset([])
    assert all(site.save() == dug.save() for site in env.sites)
    env.reset()
    assert all(site.save() == start.save() for site in env.sites)


def test_bad_resets_change_nothing(start):
    env = soilvdb.VectorSite(start, COUNT)
    env.step(0, positions=paths()[0][5])
    before = [site.save() for site in env.sites]
    other = soilvdb.Site(0.2, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)])
    wider = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.3, 0.9, PROFILE)])
    for arguments, error, message in [
            ((np.ones(COUNT + 1, bool),), ValueError, "mask has the shape"),
            (([0, 0],), ValueError, "each once"),
            (([COUNT],), ValueError, "0 to 4"),
            (([-1],), ValueError, "0 to 4"),
            (([0.5],), ValueError, "numbers of sites"),
            (([0, 1], [start]), ValueError, "1 states for 2 sites"),
            (([0, 1], [start, 3]), TypeError, "not int"),
            (([0, 1], [start, b"x"]), ValueError, "not a saved state"),
            (([0], other), ValueError, "another voxel size"),
            (([0], wider), ValueError, "site 0: the state is of other machines"),
            (([0], bytearray(start.save())), TypeError, "not bytearray")]:
        with pytest.raises(error, match=message):
            env.reset(*arguments)
    for values, message in [({"swell": [0.1, 0.2]}, "swell has the shape"),
                            ({"repose_angle": 0.6, "swell": -1}, "swell"),
                            ({"heights": np.zeros((2, 3, 3)), "origin": (0, 0), "cell": 1}, "5, ny"),
                            ({"repose_angle": np.nan}, "repose_angle is nan"),
                            ({"z": [0, 0, 0, 0, np.nan]}, "finite")]:
        with pytest.raises(ValueError, match=message):
            env.randomise(**values)
    assert [site.save() for site in env.sites] == before


def test_each_site_has_its_own_soil_and_terrain(start):
    env = soilvdb.VectorSite(start, COUNT)
    repose, z = np.linspace(0.4, 0.8, COUNT), np.linspace(-1, 1, COUNT)
    env.randomise(repose_angle=repose, density=1900.0, cohesion=np.nan, z=z,
                  slope=[(0.01 * i, 0) for i in range(COUNT)])
    for i, site in enumerate(env.sites):
        assert site.heights([(2, 0)])[0] == pytest.approx(z[i] + 0.02 * i)
        alone = soilvdb.Site(0.1, soilvdb.plane(z[i], (0.01 * i, 0)),
                             [soilvdb.Bucket(1.2, 0.9, PROFILE)],
                             soil=soilvdb.Soil(repose[i], swell_of(start), 1900.0))
        assert site.save() == alone.save()
    env.step(0, positions=np.stack([0 * z, 0 * z, z - 0.2], 1))
    env.reset([1, 2])
    assert env.sites[1].heights([(0, 0)])[0] == pytest.approx(z[1])
    heights = np.random.default_rng(1).uniform(0, 1, (2, 4, 6))
    env.randomise([0, 3], heights=heights, origin=(-2, -1), cell=1.0)
    assert env.sites[3].heights([(-1, 1), (1, 0)]) == pytest.approx(
        [heights[1, 2, 1], heights[1, 1, 3]], abs=1e-6)
    assert env.sites[1].heights([(0, 0)])[0] == pytest.approx(z[1])


def swell_of(site):
    soil = site._made_from[3]
    return soil.swell if soil else 0.0


class OnlyDLPack:
    """One whose memory is to be had in no other way."""

    def __init__(self, values):
        self.values = values

    def __dlpack__(self, **_):
        return self.values.__dlpack__()

    def __dlpack_device__(self):
        return self.values.__dlpack_device__()


def test_arrays_go_to_other_libraries_without_a_copy(start):
    env = soilvdb.VectorSite(start, COUNT)
    steps = env.step(0, positions=paths()[0][4])
    assert np.shares_memory(np.from_dlpack(steps.bucket_m3), steps.bucket_m3)
    assert memoryview(steps.status).nbytes == COUNT
    wanted = env.height_map(machine=0, shape=(3, 4), cell=0.2)
    memory = (ctypes.c_double * (COUNT * 12))()
    view = memoryview(memory).cast("B").cast("d", (COUNT, 3, 4))
    assert env.height_map(machine=0, shape=(3, 4), cell=0.2, out=view) is view
    assert (np.array(memory).reshape(wanted.shape) == wanted).all()

    class Tensor:
        """An array of another library, as far as NumPy can tell."""

        def __init__(self, values):
            self.values = values
            self.__array_interface__ = values.__array_interface__

        def __dlpack__(self, **_):
            return self.values.__dlpack__()

    class Copies(OnlyDLPack):
        """One that gives NumPy a copy: writing into that would fill nothing."""

        def __array__(self, *_, **__):
            return self.values.copy()

    for kind in (Tensor, OnlyDLPack):
        tensor = kind(np.zeros((COUNT, 3, 4), np.float32))
        assert env.height_map(machine=0, shape=(3, 4), cell=0.2, out=tensor) is tensor
        assert (tensor.values == wanted.astype(np.float32)).all()
    for bad in (bytes(COUNT * 96), [[0.0] * 4] * 3, Copies(np.zeros((COUNT, 3, 4), np.float32))):
        with pytest.raises(ValueError, match="out must be a writable"):
            env.height_map(machine=0, shape=(3, 4), cell=0.2, out=bad)


def test_arrays_that_cant_be_filled_are_refused(start):
    look = {"machine": 0, "shape": (3, 4), "cell": 0.2}
    env = soilvdb.VectorSite(start, COUNT)
    env.step(0, positions=np.zeros((COUNT, 3)))
    whole = np.zeros((COUNT, 3, 8))
    read_only = np.zeros((COUNT, 3, 4))
    read_only.flags.writeable = False
    unaligned = np.zeros(8 * COUNT * 12 + 1, np.uint8)[1:].view(float).reshape(COUNT, 3, 4)
    for bad in (whole[:, :, ::2], whole[:, :, :4], read_only, unaligned, np.zeros((COUNT, 4, 3)),
                np.zeros((COUNT, 3, 4), ">f8"), np.zeros((COUNT, 3, 4), int)):
        before = bad.copy()
        with pytest.raises(ValueError, match=r"out must be a writable .* shape \(5, 3, 4\)"):
            env.height_map(**look, out=bad)
        assert (bad == before).all()


def test_sites_that_begin_anew_are_where_work_was_said_to_be_and_as_strict():
    far = (5e5, 5.4e6, 300.0)
    near = soilvdb.Site(0.1, soilvdb.plane(300.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)], near=far,
                        limits=False)
    env = soilvdb.VectorSite(near, 2)
    env.randomise(z=[299.0, 301.0])
    for site, z in zip(env.sites, (299.0, 301.0)):
        alone = soilvdb.Site(0.1, soilvdb.plane(z), [soilvdb.Bucket(1.2, 0.9, PROFILE)], near=far)
        assert site.save() == alone.save() and not site.limits
        with pytest.raises(ValueError, match="near"):
            site.height_map(origin=(0, 0), shape=(2, 3), cell=0.1)
    env, strict = soilvdb.VectorSite(near, 2), near.clone()
    strict.limits = True
    for states in (strict, strict.save(), [strict, near]):
        env.reset(states=states)
        assert [site.limits for site in env.sites] == [False, False]


def test_wrong_calls_are_told(start):
    env = soilvdb.VectorSite(start, 2)
    env.step(0, positions=np.zeros((2, 3)))
    for call, error, message in [
            (lambda: env.step(0), TypeError, "one of positions"),
            (lambda: env.step(0, positions=np.zeros((3, 3))), ValueError, "3 states for 2 sites"),
            (lambda: env.step(1, positions=np.zeros((2, 3))), ValueError, "no machine 1"),
            (lambda: env.step(0, joints={"boom": [0, 0]}), ValueError, "machine has none"),
            (lambda: env.step(0, joints=np.zeros((2, 2))), soilvdb.StateError, "machine has none"),
            (lambda: env.step(0, positions=np.zeros((2, 3)), times=np.array([1 + 1j, 2])), TypeError,
             "times must be numbers, not an array of complex128"),
            (lambda: env.randomise(z=[1j, 2]), TypeError, "z must be numbers"),
            (lambda: soilvdb.VectorSite(start, 0), ValueError, "count is 0"),
            (lambda: env.step(0, positions=np.zeros((2, 3)), times=[1, 2, 3]), ValueError,
             r"times has the shape \(3,\)"),
            (lambda: env.step(0, positions=np.ma.masked_equal(np.zeros((2, 3)), 0)), TypeError,
             "masked"),
            (lambda: soilvdb.VectorSite(start, 2.5), ValueError, "count is 2.5; it must be a whole"),
            (lambda: soilvdb.VectorSite(start, True), ValueError, "count is True; it must be a whole"),
            (lambda: soilvdb.VectorSite(start, 2, threads=True), TypeError, "int or None, not bool"),
            (lambda: soilvdb.VectorSite(None, 2), TypeError, "not NoneType"),
            (lambda: soilvdb.VectorSite(start, 2, threads=10**7), ValueError, "must be 1 to 1024"),
            (lambda: env.height_map(machine=0, shape=(2, 2), cell=0.1, layer="design"), ValueError,
             "needs the design"),
            (lambda: soilvdb.VectorSite(start, 2, threads="a"), TypeError, "int or None, not str"),
            (lambda: soilvdb.VectorSite(start, 2, threads=0), ValueError, "threads is 0")]:
        with pytest.raises(error, match=message) as told:
            call()
        assert "\n" not in str(told.value)


def test_arrays_come_from_other_libraries(start):
    """Also those that offer nothing but DLPack."""
    positions, rotations = paths()
    env, same = soilvdb.VectorSite(start, COUNT), soilvdb.VectorSite(start, COUNT)
    for n, (p, q) in enumerate(zip(positions, rotations)):
        env.step(0, positions=p, rotations=q, times=np.full(COUNT, float(n)))
        same.step(0, positions=OnlyDLPack(p), rotations=OnlyDLPack(q),
                  times=OnlyDLPack(np.full(COUNT, n, np.float32)))
    assert [s.save() for s in env.sites] == [s.save() for s in same.sites]
    site, xy = same.sites[0], np.random.default_rng(1).uniform(-1, 3, (40, 2))
    assert (site.heights(OnlyDLPack(xy)) == site.heights(xy)).all()
    assert site.volume(OnlyDLPack(xy[:3])).cut_m3 == site.volume(xy[:3]).cut_m3
    down = np.array([(0.0, 0.0, -1.0)])
    assert site.cast(OnlyDLPack(np.array([1.0, 0.1, 4.0])), OnlyDLPack(down)) == site.cast(
        (1.0, 0.1, 4.0), down)
    assert start.clone().update(0, position=OnlyDLPack(np.array([0.0, 0.0, 1.0]))).cut_m3 == 0
    ground = [soilvdb.Site(0.1, soilvdb.raster(heights, origin=(0, 0), cell=1.0), []) for heights in
              (OnlyDLPack(np.eye(3)), np.eye(3))]
    assert ground[0].heights([(0.3, 0.2)]) == ground[1].heights([(0.3, 0.2)])
    same.randomise(repose_angle=OnlyDLPack(np.linspace(0.5, 0.7, COUNT)))
    assert same.sites[2].soil.repose_angle == pytest.approx(0.6)
    same.reset(OnlyDLPack(np.array([0, 1])))
    with pytest.raises(TypeError, match="xy must be numbers, not OnlyDLPack|complex"):
        site.heights(OnlyDLPack(xy.astype(complex)))


def test_a_machine_without_a_place_has_a_map_of_nan(start):
    env = soilvdb.VectorSite(start, COUNT)
    look = {"machine": 0, "shape": (3, 4), "cell": 0.2}
    env.step(0, positions=paths()[0][5])
    assert np.isfinite(env.height_map(**look)).all()
    env.randomise([1, 3], z=0.5)
    for layer in ("height", "loose", "dug"):
        maps = env.height_map(**look, layer=layer)
        assert np.isnan(maps).all(axis=(1, 2)).tolist() == [False, True, False, True, False]
        assert np.isfinite(maps[[0, 2, 4]]).all()
    env.step(0, positions=np.full((COUNT, 3), [0.0, 0.0, 2.0]))
    assert np.isfinite(env.height_map(**look)).all()
    poses = np.tile(np.eye(4), (COUNT, 1, 1))
    poses[:, 0, 3] = np.arange(COUNT)
    at = env.height_map(pose=poses, shape=(3, 4), cell=0.2, turned=False)
    for site, pose, one in zip(env.sites, poses, at):
        assert (site.height_map(pose=pose, shape=(3, 4), cell=0.2) == one).all()


def test_numbers_of_sites_and_threads_may_be_those_of_numpy(start):
    env = soilvdb.VectorSite(start, np.int64(3), threads=np.uint8(2))
    assert env.count == 3
    assert env.step(0, positions=np.zeros((3, 3))).status.tolist() == [0, 0, 0]


def test_errors_of_many_sites_say_of_which_they_are(start):
    env = soilvdb.VectorSite(start, 3)
    good = start.save()
    closed = start.clone()
    closed.close()
    before = [site.save() for site in env.sites]
    for call, kind, message in [
            (lambda: env.randomise(repose_angle=[0.5, -1, 0.6]), ValueError, "site 1: the angle"),
            (lambda: env.randomise([0, 2], repose_angle=[0.5, 2]), ValueError, "site 2: the angle"),
            (lambda: env.randomise(slope=[(0, 0), (0, 0), (np.inf, 0)]), ValueError, "site 2: the plane"),
            (lambda: env.randomise([1, 2], heights=np.full((2, 3, 3), np.nan), origin=(0, 0), cell=1.0),
             ValueError, "site 1: "),
            (lambda: env.reset(None, [good, b"xx", good]), ValueError, "site 1: not a saved state"),
            (lambda: env.reset(None, [good, good, closed]), RuntimeError, "site 2: the site is closed"),
            (lambda: soilvdb.height_maps([start, closed], origin=(0, 0), shape=(1, 1), cell=1.0),
             RuntimeError, "site 1: the site is closed"),
            (lambda: env.height_map(origin=(0, 0), shape=(1, 1), cell=1e3), ValueError, "site 0: a map's"),
            (lambda: soilvdb.resistances([start], 0), ValueError, "site 0: soil is rigid") if
            start.soil is None else (lambda: soilvdb.resistances([start], 1), ValueError, "site 0: ")]:
        with pytest.raises(kind, match=f"^{message}"):
            call()
    assert [site.save() for site in env.sites] == before


def test_a_file_that_cant_be_read_is_told_with_the_site(tmp_path):
    file = tmp_path / "ground.tif"
    soilvdb.write_raster(file, np.random.default_rng(0).normal(0, 0.1, (2000, 2000)), (0, 0), (0.5, 0.5))
    site = soilvdb.Site(0.1, soilvdb.raster(file), [])
    os.truncate(file, 3000)
    with pytest.raises(RuntimeError, match="^site 0: .*ground.tif: is damaged"):
        soilvdb.height_maps([site], origin=(700, 700), shape=(2, 2), cell=0.1)


def test_a_closed_site_fails_alone(start):
    env = soilvdb.VectorSite(start, 3)
    env.sites[0].close()
    for positions in ([(0, 0, -0.2)] * 3, [(1, 0, -0.2)] * 3):
        steps = env.step(0, positions=positions)
        assert steps.status.tolist() == [3, 0, 0]
        assert str(steps.errors[0]) == "site 0: the site is closed"
        assert isinstance(steps.errors[0], RuntimeError)
    assert np.isnan(steps.bucket_m3[0]) and (steps.bucket_m3[1:] > 0).all()
    with pytest.raises(RuntimeError, match="^site 0: the site is closed"):
        soilvdb.update_many(env.sites, 0, positions=[(2, 0, -0.2)] * 3)
    assert (env.sites[2].pose(0)[0] == (2, 0, -0.2)).all(), "the others have moved"
    for call in (lambda: env.height_map(machine=0, shape=(2, 2), cell=0.1), lambda: env.loads(0),
                 lambda: env.resistance(0, soil=LOAM)):
        with pytest.raises(RuntimeError, match="^site 0: the site is closed"):
            call()
    env.reset([0])
    assert not env.step(0, positions=[(2, 0, -0.2)] * 3).errors


def test_a_warning_of_steps_comes_once_and_names_the_site_and_the_callers_line(start):
    env = soilvdb.VectorSite(start, 3)
    back = np.arange(0, -3, -0.25)
    ways = np.stack([back, 0 * back, np.full(len(back), -0.3)], 1)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for _ in range(2):
            for p in ways:
                env.step(0, positions=[(0, 5, 2), p, p])
            env.reset()
    assert [str(w.message).split("moved")[0] for w in told] == ["site 1: machine 'machine 0' "]
    assert told[0].filename == __file__
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for p in ways:
            soilvdb.update_many(env.sites[1:], 0, positions=[p, p])
    assert [str(w.message).split("moved")[0] for w in told] == ["site 0: machine 'machine 0' "]
    assert told[0].filename == __file__


def test_a_soil_of_its_own_leaves_heights_open(tmp_path):
    """A file is not read again: here it is gone."""
    heights = np.random.default_rng(2).normal(0, 0.1, (41, 41))
    file = tmp_path / "ground.tif"
    soilvdb.write_raster(file, heights, (-10, -10), (0.5, 0.5))
    bucket = soilvdb.Bucket(1.2, 0.9, PROFILE)

    def site_of(soil):
        return soilvdb.Site(0.1, soilvdb.raster(file), [bucket], soil=soil, limits=False)

    start, repose = site_of(LOAM), np.array([0.5, 0.6, 0.7])
    alone = [site_of(soilvdb.Soil(repose_angle=angle, swell=0.25)) for angle in repose]
    start.update_path(0, positions=[(0, 0, -0.4), (3, 0, -0.4)])  # it begins untouched all the same
    env = soilvdb.VectorSite(start, 3)
    file.unlink()
    for _ in range(2):
        env.randomise(repose_angle=repose)
        assert [s.save() for s in env.sites] == [s.save() for s in alone]
        assert [s.limits for s in env.sites] == [False] * 3
        assert [s.soil.repose_angle for s in env.sites] == repose.tolist()
        for steps in ([(0, 1, 1)] * 3, [(2, 1, -0.4)] * 3):
            env.step(0, positions=steps)
        for site in alone:
            site.update_path(0, positions=[(0, 1, 1), (2, 1, -0.4)])
        assert [s.save() for s in env.sites] == [s.save() for s in alone]
        for site in alone:
            site.close()
        alone = [s.clone() for s in env._starts]
    other = soilvdb.raster(heights, origin=(-10, -10), cell=0.5)
    same = soilvdb.VectorSite(soilvdb.Site(0.1, other, [bucket], soil=LOAM), 2)
    same.randomise(repose_angle=0.5)
    assert same.sites[0].save() == soilvdb.Site(
        0.1, other, [bucket], soil=soilvdb.Soil(repose_angle=0.5, swell=0.25)).save()


class Stopped(Exception):
    """Of a signal."""


@pytest.fixture
def stop_soon():
    """Raises Stopped when so much of the processor was used, s."""
    def stop(*_):
        raise Stopped

    before = signal.signal(signal.SIGPROF, stop)
    yield lambda seconds: signal.setitimer(signal.ITIMER_PROF, seconds)
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.signal(signal.SIGPROF, before)


@pytest.mark.parametrize("count, shape, cell", [(2, (400, 400), 0.8), (2000, (60, 60), 0.1)])
def test_a_signal_ends_a_long_look_at_many_sites(stop_soon, count, shape, cell):
    """Of large maps, and of many."""
    env = soilvdb.VectorSite(
        soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)]), count)
    maps = np.full((count, *shape), -1.0, np.float32)
    stop_soon(0.05)
    with pytest.raises(Stopped):
        env.height_map(origin=(-100, -100), shape=shape, cell=cell, out=maps)
    assert maps[0, 0, 0] == 0 and maps[-1, -1, -1] == -1
    assert (env.height_map(origin=(0, 0), shape=(2, 2), cell=0.1) == 0).all()


def test_a_signal_ends_a_long_step_between_sites(stop_soon):
    env = soilvdb.VectorSite(
        soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)]), 1000)
    env.step(0, positions=np.tile([0, 0, -0.3], (1000, 1)))
    stop_soon(0.05)
    with pytest.raises(Stopped):
        env.step(0, positions=np.tile([20, 0, -0.3], (1000, 1)))
    assert [site.pose(0)[0][0] for site in (env.sites[0], env.sites[-1])] == [20, 0]
    env.reset()
    assert not env.step(0, positions=np.tile([0, 0, 1], (1000, 1))).errors
