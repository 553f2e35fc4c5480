# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A site refuses what no machine does, says so by typed errors, and warns of a bucket held the wrong
way round."""

import pickle
import types
import warnings
from pathlib import Path

import numpy as np
import pytest

import soilvdb

DATA = Path(__file__).parents[2] / "data"
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
HOME = (0.0, 0.5, -1.5, 0.0)  # swing, boom, arm, bucket


def excavator(limits=True):
    machine = soilvdb.Machine(soilvdb.Bucket(1.2, 0.9, PROFILE), "digger",
                              urdf=DATA / "excavator.urdf", link="bucket_link")
    return soilvdb.Site(0.2, soilvdb.plane(-3.0), [machine], limits=limits)


def plain(limits=True):
    return soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)], limits=limits)


def by_joints(*joints, time=None):
    return {"joints": joints, "time": time}


@pytest.mark.parametrize("states, why", [
    ([by_joints(0, 2.0, -1.5, 0)], "joint boom_joint is at 2 rad; the urdf limits it to -0.87 to 1.13"),
    ([by_joints(0, 45.0, -90.0, 0)], "are these degrees"),
    ([by_joints(*HOME, time=0), by_joints(0, 0.9, -1.5, 0, time=0.1)],
     "joint boom_joint turns 0.4 rad in 0.1 s since the state before; its velocity limit"),
    ([by_joints(*HOME, time=0), by_joints(200, 0.5, -1.5, 0, time=900)], "at most 100 rad in one state"),
])
def test_joints_beyond_their_limits_are_refused(states, why):
    site, free = excavator(), excavator(limits=False)
    for state in states[:-1]:
        site.update("digger", **state)
        free.update("digger", **state)
    before = site.save()
    with pytest.raises(soilvdb.StateError, match=why) as told:
        site.update("digger", **states[-1])
    assert site.save() == before
    assert told.value.machine == "digger"
    assert str(told.value) == "machine 'digger': " + told.value.reason
    assert isinstance(told.value, ValueError)
    free.update("digger", **states[-1])
    assert free.save() != before


@pytest.mark.parametrize("states, why", [
    ([((0, 0, 1), None), ((101, 0, 1), None)], "would move 101 m in one state"),
    ([((0, 0, 1), 1.0), ((6, 0, 1), 1.1)], "the bucket moves 6 m in 0.1 s since the state before"),
])
def test_jumps_are_refused(states, why):
    (first, t0), (last, t1) = states
    site = plain()
    site.update(0, position=first, time=t0)
    before = site.save()
    with pytest.raises(soilvdb.StateError, match=why):
        site.update(0, position=last, time=t1)
    with pytest.raises(soilvdb.StateError, match="state 1: .*" + why):
        site.update_path(0, positions=[first, last], times=None if t0 is None else [t0, t1])
    assert site.save() == before or t0 is not None
    site.limits = False
    for copy in (site.clone(), pickle.loads(pickle.dumps(site)), site):
        assert not copy.limits
        copy.update(0, position=last, time=t1)
    with pytest.raises(soilvdb.StateError):  # the jump back
        plain_again = site.clone()
        plain_again.limits = True
        plain_again.update(0, position=first, time=None if t1 is None else t1 + 0.01)


def test_limits_do_not_change_what_is_dug():
    sites = [plain(limits) for limits in (True, False)]
    positions = np.stack([np.linspace(0, 3, 40), np.zeros(40), -np.linspace(-0.1, 0.4, 40)], 1)
    for site in sites:
        site.update_path(0, positions=positions, times=np.arange(40) / 10)
    assert sites[0].save() == sites[1].save()


def test_joints_have_names_in_every_call():
    sites = [excavator() for _ in range(4)]
    names = sites[0].joints("digger")
    path = np.array(HOME) + np.linspace(0, 1, 5)[:, None] * (0.2, -0.3, 0.1, -0.4)
    columns = dict(zip(names, path.T))
    for row in path:
        sites[0].update("digger", joints=row)
        sites[1].update(0, joints=dict(reversed(list(zip(names, row)))))
    sites[2].update_path("digger", joints=columns)
    env = soilvdb.VectorSite(sites[3], 2)
    for row in path:
        steps = env.step(0, joints=types.MappingProxyType(dict(zip(names, np.tile(row[:, None], 2)))))
    assert (steps.status == 0).all()
    assert sites[0].save() == sites[1].save() == sites[2].save() == env.sites[1].save()
    for got, wanted in zip(sites[0].pose("digger", columns), sites[0].pose("digger", path)):
        assert got.shape[0] == 5 and (got == wanted).all()
    for got, wanted in zip(sites[0].pose("digger"), sites[0].pose("digger", path[-1])):
        assert (got == wanted).all()
    with pytest.raises(ValueError, match="unknown joint .bom_joint.; did you mean .boom_joint."):
        sites[0].update(0, joints={"bom_joint": 1.0})
    with pytest.raises(ValueError, match=f"joint '{names[-1]}' is missing"):
        sites[0].pose(0, dict.fromkeys(names[:-1], 0.0))
    with pytest.raises(ValueError, match="no pose before its first state"):
        sites[3].pose("digger")


def test_a_bucket_that_moves_backwards_is_warned_of_once():
    site = plain()
    with pytest.warns(UserWarning, match="machine 'machine 0' moved backwards .* x axis") as told:
        for i, x in enumerate(np.linspace(0, -6, 61)):
            site.update(0, position=(x, 0, -0.2))
            assert len(told) == (x <= -2 - 0.05) or i == 20
    assert len(told) == 1
    with pytest.warns(UserWarning, match="backwards") as told:
        plain().update_path(0, positions=[(x, 0, -0.2) for x in np.linspace(0, -6, 61)])
    assert len(told) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        good = plain()
        for stroke in range(4):  # digs forwards, goes back in the air, then levels a little
            for x in np.linspace(0, 3, 31):
                good.update(0, position=(x, 0, -0.1 * (stroke + 1)))
            for x in np.linspace(3, 0, 31):
                good.update(0, position=(x, 0, 0.5))
            for x in np.linspace(0, -0.9, 10):
                good.update(0, position=(x, 2, -0.1 * (stroke + 1)))
            good.update(0, position=(0, 0, 0.5))
        blade = soilvdb.Site(0.1, soilvdb.plane(0.0), [_tool()])
        for x in np.linspace(0, -6, 61):
            blade.update(0, position=(x, 0, -0.2))


def test_voxels_that_are_large_beside_a_bucket_are_warned_of(tmp_path):
    bucket = soilvdb.Bucket(1.0, 0.8)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        soilvdb.Site(0.4, soilvdb.plane(0.0), [bucket])
    with pytest.warns(UserWarning, match="voxels of 0.41 m are too large for the bucket of machine 0, "
                                         "1 m x 0.8 m; .* use 0.16 m or less") as told:
        site = soilvdb.Site(0.41, soilvdb.plane(0.0), [bucket])
        for x in range(5):
            site.clone().update(0, position=(x, 0, -0.2))
    assert len(told) == 1
    (tmp_path / "pit.yaml").write_text("soilvdb: 1\nvoxel_size: 5\nterrain: {plane: {z: 0}}\nmachines:\n"
                                       "  - {name: digger, bucket: {width: 1.0, height: 0.8}}\n")
    with pytest.warns(UserWarning, match="voxels of 5 m are larger than the bucket of digger"):
        soilvdb.Site.open(tmp_path / "pit.yaml")


def test_a_warning_that_is_an_error_costs_no_result(capfd):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = soilvdb.VectorSite(plain(), 1)
        for x in np.linspace(0, -3, 31):
            steps = env.step(0, positions=[(x, 0, -0.2)])
        assert steps.status[0] == 0
    with pytest.warns(UserWarning, match="backwards"), pytest.raises(soilvdb.StateError):
        plain().update_path(0, positions=[(x, 0, -0.2) for x in np.linspace(0, -6, 61)]
                            + [(np.nan, 0, 0)])


def test_limits_are_true_or_false():
    site = plain()
    for wrong in (None, 2.5, "no"):
        with pytest.raises(TypeError):
            site.limits = wrong
        with pytest.raises(TypeError):
            soilvdb.Site(0.1, soilvdb.plane(0.0), [], limits=wrong)
    assert site.limits


def test_a_lip_is_where_it_is_on_its_link():
    lip = np.eye(4)
    lip[:3, 3] = (1.42, 0.1, -0.2)
    lip[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    machine = soilvdb.Machine(soilvdb.Bucket(1.2, 0.9, PROFILE), "digger",
                              urdf=DATA / "excavator.urdf", link="bucket_link", lip=lip)
    site = soilvdb.Site(0.2, soilvdb.plane(-3.0), [pickle.loads(pickle.dumps(machine))])
    (at, turn), (x, y, z, w) = excavator().pose("digger", HOME), excavator().pose("digger", HOME)[1]
    axes = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    assert site.pose("digger", HOME)[0] == pytest.approx(at + axes @ lip[:3, 3])
    assert abs(site.pose("digger", HOME)[1] @ turn) == pytest.approx(np.sqrt(0.5))  # a quarter turn


def test_a_reason_is_without_the_machine():
    with pytest.raises(soilvdb.StateError) as told:
        excavator().update("digger", joints=(0.0, 0.0))
    assert told.value.reason.startswith("has 4 joints, not 2")


def test_joints_by_name_of_machines_without_any_are_told():
    site = plain()
    for call in (lambda: site.update(0, joints={}), lambda: site.pose(0, {}),
                 lambda: site.update_path(0, joints={"boom_joint": [1.0]})):
        with pytest.raises(ValueError, match="the machine has none"):
            call()
    with pytest.raises(ValueError, match="as many values of each joint"):
        arm = excavator()
        names = arm.joints("digger")
        arm.update_path("digger", joints={n: [0.0] * (i + 1) for i, n in enumerate(names)})


def _tool():
    import tempfile
    corners = [(x, y, z) for x in (0, 0.3) for y in (-0.5, 0.5) for z in (0, 0.6)]
    faces = [(1, 3, 4, 2), (5, 6, 8, 7), (1, 2, 6, 5), (3, 7, 8, 4), (1, 5, 7, 3), (2, 4, 8, 6)]
    with tempfile.TemporaryDirectory() as folder:
        mesh = Path(folder) / "blade.obj"
        mesh.write_text("".join("v %g %g %g\n" % c for c in corners) +
                        "".join("f %d %d %d\nf %d %d %d\n" % (a, b, c, a, c, d)
                                for a, b, c, d in faces))
        return soilvdb.tool(mesh, 0.05)
