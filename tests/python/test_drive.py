# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Machines that drive: the base beside the joints, in every call that takes joints."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import soilvdb

DATA = Path(__file__).parents[2] / "data"
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
JOINTS = ["swing_joint", "boom_joint", "arm_joint", "bucket_joint"]
HOME = np.array([0.0, 0.5, -1.5, 0.0])
LIP = np.array([[-1.0, 0, 0, 1.42], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]])  # looks back


def excavator(**options):
    machine = soilvdb.Machine(soilvdb.Bucket(1.2, 0.9, PROFILE), "digger",
                              urdf=DATA / "excavator.urdf", link="bucket_link", lip=LIP)
    return soilvdb.Site(0.1, soilvdb.plane(0.0), [machine], **options)


def drive(count=40, seed=1):
    """Times, joints, and positions and rotations of the base, whose bucket digs 0.2 m deep."""
    random = np.random.default_rng(seed)
    times = 0.2 * np.arange(count)
    joints = HOME + np.cumsum(random.uniform(-0.02, 0.02, (count, 4)), axis=0)
    lip = excavator().pose("digger", joints)[0]
    yaw = 0.3 + np.cumsum(random.uniform(-0.05, 0.05, count))
    positions = np.stack([-0.15 * np.arange(count), random.uniform(-0.02, 0.02, count),
                          -0.2 - lip[:, 2]], axis=1)
    zero = np.zeros(count)
    return times, joints, positions, np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)


def matrices(positions, rotations):
    """(N, 4, 4) of poses that turn about z."""
    all_of_them = np.tile(np.eye(4), (len(positions), 1, 1))
    sin, cos = (2 * rotations[:, 2] * rotations[:, 3], rotations[:, 3] ** 2 - rotations[:, 2] ** 2)
    all_of_them[:, 0, 0] = all_of_them[:, 1, 1] = cos
    all_of_them[:, 1, 0], all_of_them[:, 0, 1] = sin, -sin
    all_of_them[:, :3, 3] = positions
    return all_of_them


def test_it_digs_as_its_bucket_fed_by_poses():
    times, joints, positions, rotations = drive()
    driven, posed = excavator(), excavator()
    for q, p, r in zip(joints, positions, rotations):
        at = excavator().pose("digger", q, (p, r))
        turned, arm = matrices(p[None], r[None])[0], excavator().pose("digger", q)[0]
        assert np.abs(turned[:3, :3] @ arm + p - at[0]).max() < 1e-9
        driven.update("digger", joints=q, base=(p, r))
        posed.update("digger", position=at[0], rotation=at[1])
    assert driven.ledger("digger")["cut_m3"] > 0.5
    assert driven.ground_hash() == posed.ground_hash()
    assert np.array_equal(driven.base("digger")[0], positions[-1])
    assert np.array_equal(driven.pose("digger")[0], driven.pose("digger", joints[-1])[0])


def test_every_call_has_it():
    times, joints, positions, rotations = drive()
    one_by_one, path = excavator(), excavator()
    for t, q, p, r in zip(times, joints, positions, rotations):
        one_by_one.update("digger", joints=dict(zip(JOINTS, q)), base=(p, r), time=t)
    path.update_path(0, joints=joints, base=(positions, rotations), times=times)
    assert path.save() == one_by_one.save()
    rows = path.pose(0, joints, (positions, rotations))
    for i in (0, 17):
        one = path.pose(0, joints[i], base=(positions[i], rotations[i]))
        assert np.array_equal(rows[0][i], one[0]) and np.array_equal(rows[1][i], one[1])
    vector = soilvdb.VectorSite(excavator(), 2)
    for i in range(len(times)):
        steps = vector.step("digger", joints=np.tile(joints[i], (2, 1)), times=times[i],
                            base=(np.tile(positions[i], (2, 1)), np.tile(rotations[i], (2, 1))))
        assert not steps.errors
    assert vector.sites[0].save() == vector.sites[1].save() == path.save()
    by_matrices = excavator()
    by_matrices.update_path(0, joints=joints, base=matrices(positions, rotations), times=times)
    assert by_matrices.ledger(0)["cut_m3"] == pytest.approx(path.ledger(0)["cut_m3"], rel=1e-4)
    by_matrices.place("digger", joints=HOME, base=matrices(positions + [0, 0, 9], rotations)[0])
    assert by_matrices.base(0)[0][2] == positions[0, 2] + 9


def test_it_holds_until_another_is_given_over_saves_clones_and_recordings(tmp_path):
    times, joints, positions, rotations = drive()
    told, held = excavator(), excavator()
    held.record(tmp_path / "site")
    for i, (t, q) in enumerate(zip(times, joints)):
        last = i - i % 4
        told.update(0, joints=q, base=(positions[last], rotations[last]), time=t)
        if i % 7 == 6:  # each goes on with the same base
            held.close()
            held = excavator()
            held.record(tmp_path / "site")
        if i % 7 == 3:
            clone = held.clone()
            restored = excavator()
            restored.restore(held.save())
            for site in (clone, restored):
                site.update(0, joints=q, time=t, base=(positions[i], rotations[i]) if i == last else None)
        held.update(0, joints=q, time=t, base=(positions[i], rotations[i]) if i == last else None)
        if i % 7 == 3:
            assert clone.save() == restored.save() == held.save()
    assert held.save() == told.save()


def rows_csv(file, times, joints, positions, rotations):
    with open(file, "w", newline="", encoding="utf-8") as text:
        writer = csv.writer(text)
        writer.writerow(["time", *JOINTS, *(f"base_{axis}" for axis in
                                            ("x", "y", "z", "qx", "qy", "qz", "qw"))])
        writer.writerows(np.hstack([times[:, None], joints, positions, rotations]).tolist())


def scenario(folder, more=""):
    path = folder / "drive.yaml"
    path.write_text(f"""\
soilvdb: 1
voxel_size: 0.1
terrain: {{plane: {{z: 0.0}}}}
machines:
  - name: digger
    bucket: {{width: 1.2, height: 0.9, profile: {[list(p) for p in PROFILE]}}}
    urdf: {DATA / "excavator.urdf"}
    lip: {{link: bucket_link, xyz: [1.42, 0, 0], rpy: [0, {math.pi}, 0]}}
    motion: drive.csv
{more}""")
    return path


def test_rows_of_a_run_are_those_of_a_site(tmp_path):
    times, joints, positions, rotations = drive()
    rows_csv(tmp_path / "drive.csv", times, joints, positions, rotations)
    path = scenario(tmp_path)
    rows = soilvdb.motions(path)["digger"]
    assert np.array_equal(rows["joints"], joints) and np.array_equal(rows["base"][0], positions)
    site = soilvdb.Site.open(path)
    site.update_path("digger", **rows)
    summary = soilvdb.run(path, out=tmp_path / "out")
    assert int(summary["state_hash"], 16) == site.ground_hash()
    assert summary["volume_m3"]["cut"] > 0.5


def test_errors_of_its_base_are_about_where_it_stands(tmp_path):
    times, joints, positions, rotations = drive()
    noise = {"position": {"bias": [0.0, 0.0, 0.01]}, "rotation": {"bias": [0.0, 0.0, 0.001]}}
    spreads = []
    for x in (0.0, 40.0):  # far from where the scenario has it
        ensemble = soilvdb.Ensemble(excavator(), noise, clones=8)
        for t, q, p, r in zip(times, joints, positions + [x, 0, 0], rotations):
            ensemble.update("digger", joints=q, base=(p, r), time=t)
        spreads.append(ensemble.cut("digger"))
    assert spreads[0].sigma > 0.001
    assert spreads[0].sigma == pytest.approx(spreads[1].sigma, rel=0.05)


@pytest.mark.parametrize("state, error, why", [
    (dict(joints=HOME, base=np.eye(3)), ValueError, r"base: pose has the shape \(3, 3\)"),
    (dict(joints=HOME, base=((0, 0), (0, 0, 0, 1))), ValueError, "base: position"),
    (dict(joints=HOME, base=((0, 0, 0), (0, 0, 0, 2))), soilvdb.StateError,
     "base: the rotation is a quaternion of length 2; it must be of length 1"),
    (dict(joints=HOME, base=((0, np.nan, 0), (0, 0, 0, 1))), soilvdb.StateError,
     "base: the position is .* it must be finite"),
    (dict(joints=HOME, base=2 * np.eye(4)), ValueError, "base: pose is not a rigid transform"),
    (dict(joints=HOME, base=((101, 0, 5), (0, 0, 0, 1))), soilvdb.StateError,
     "its base would move 101 m in one state"),
    (dict(joints=HOME, base=((8, 0, 5), (0, 0, 0, 1)), time=0.1), soilvdb.StateError,
     "the base moves 8 m in 0.1 s since the state before; no machine does more than 50 m/s"),
    (dict(position=(0, 0, 0), base=np.eye(4)), TypeError, "base goes with joints"),
])
def test_what_cant_be_is_refused_and_changes_nothing(state, error, why):
    site = excavator()
    site.update(0, joints=HOME, base=((0, 0, 5), (0, 0, 0, 1)), time=0.0)
    before = site.save()
    with pytest.raises(error, match=why):
        site.update(0, **state)
    assert site.save() == before


@pytest.mark.parametrize("base, error, why", [
    ([(0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)], TypeError, "base: pose must be"),
    ("there", TypeError, "base: pose must be numbers"),
    ((0.0, (0.0, 0.0, 0.0, 1.0)), (TypeError, ValueError), "base: position"),
])
def test_what_is_no_pose_is_called_the_base(base, error, why):
    with pytest.raises(error, match=why):
        excavator().update(0, joints=HOME, base=base)


def test_rows_of_another_number_are_refused():
    times, joints, positions, rotations = drive()
    site = excavator()
    for base in ((positions[:-1], rotations[:-1]), matrices(positions, rotations)[1:]):
        with pytest.raises(ValueError, match="base: there are 39 poses for 40 states"):
            site.update_path(0, joints=joints, base=base, times=times)
    with pytest.raises(ValueError, match="base: there must be as many rotations as positions"):
        site.update_path(0, joints=joints, base=(positions, rotations[1:]), times=times)
    with pytest.raises(TypeError, match="base goes with joints"):
        site.update_path(0, positions=positions, base=(positions, rotations))
    with pytest.raises(TypeError, match="base goes with joints"):
        site.pose(0, base=np.eye(4))
    plain = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    with pytest.raises(ValueError, match="has no joints"):
        plain.base(0)


def test_joints_are_an_array_or_go_by_name_in_every_call():
    _, joints, positions, rotations = drive(6)
    named = {name: joints[:, k] for k, name in reversed(list(enumerate(JOINTS)))}
    base = matrices(positions, rotations)
    given = ({"joints": joints}, {"joints": named}, {"joints": joints.tolist()})

    def loop(site, place):
        for n in range(6):
            by_name = {name: values[n] for name, values in named.items()}
            move = site.place if place and n == 0 else site.update
            move("digger", joints=by_name if place else joints[n], base=base[n], time=float(n))
        return site

    up = base + 5 * np.eye(4)[2][:, None] * np.eye(4)[3]  # 5 m higher, in the air
    alone = loop(excavator(), False).save()
    lifted = excavator()
    for n in range(6):
        lifted.place("digger", joints={name: v[n] for name, v in named.items()}, base=up[n])
    for way in given:
        path = excavator()
        path.update_path(0, **way, base=base, times=np.arange(6.0))
        assert path.save() == alone
        raised = excavator()
        poses = raised.pose("digger", **way, base=up)
        assert np.array_equal(poses[0][-1], lifted.pose(0)[0])
    many = [excavator() for _ in range(6)]
    soilvdb.update_many(many, "digger", joints=named, base=base, times=np.arange(6.0))
    steps = soilvdb.VectorSite(excavator(), 6)
    assert not steps.step("digger", joints=named, base=base, times=np.arange(6.0)).errors
    for n, site in enumerate(many):
        one = excavator()
        one.update(0, joints=joints[n], base=base[n], time=float(n))
        assert one.save() == site.save() == steps.sites[n].save()
    noise = {"joints": {"bias": 0.001}}
    spreads = []
    for by_name in (False, True):
        ensemble = soilvdb.Ensemble(excavator(), noise, clones=4)
        for n in range(6):
            own = {k: v[n] for k, v in named.items()} if by_name else joints[n]
            ensemble.update("digger", joints=own, base=base[n])
        spreads.append(ensemble.cut())
    assert spreads[0] == spreads[1] and spreads[0].sigma > 0


@pytest.mark.parametrize("state, why", [
    (dict(joints={name: 0.0 for name in JOINTS[1:]}), "joints: joint 'swing_joint' is missing"),
    (dict(joints={name: 0.0 for name in [*JOINTS[:3], "bucket_jiont"]}),
     "unknown joint 'bucket_jiont'; did you mean 'bucket_joint'"),
    (dict(joints=HOME[:2]), "has 4 joints|4 joints|2"),
    (dict(position=(0, 0)), "position has 2 numbers; it must have 3"),
    (dict(position=(0, 0, 5), rotation=np.ones(3)), "rotation has the shape"),
    (dict(pose=2 * np.eye(4)), "pose is not a rigid transform"),
    (dict(pose=np.eye(3)), "pose has the shape"),
    (dict(joints=HOME, base=2 * np.eye(4)), "base: pose is not a rigid transform"),
])
def test_states_that_are_none_are_refused_by_name(state, why):
    site = excavator()
    site.update(0, joints=HOME, base=((0, 0, 5), (0, 0, 0, 1)))
    before = site.save()
    many = {"position": "positions", "rotation": "rotations", "pose": "poses"}
    rows = {many.get(key, key): ({name: [v] for name, v in value.items()} if isinstance(value, dict)
                                 else np.asarray(value)[None]) for key, value in state.items()}
    env = soilvdb.VectorSite(site, 1)
    calls = [lambda: site.update(0, **state), lambda: site.place("digger", **state),
             lambda: site.update_path("digger", **rows),
             lambda: soilvdb.update_many([site], 0, **rows)]
    for call in calls:
        with pytest.raises(soilvdb.StateError) as told:
            call()
        assert told.value.machine == "digger" and str(told.value).endswith(told.value.reason)
        assert "'digger'" not in told.value.reason and "\n" not in str(told.value)
    with pytest.raises(soilvdb.StateError, match=why):
        site.update(0, **state)
    try:
        error = env.step(0, **rows).errors[0]
    except soilvdb.StateError as whole:
        error = whole
    assert error.machine == "digger" and error.reason
    assert site.save() == before == env.sites[0].save()
    for call in (site.update, site.place, site.update_path):
        with pytest.raises(ValueError, match="there is no machine") as told:
            call("diger", **(rows if call == site.update_path else state))
        assert not isinstance(told.value, soilvdb.StateError)


def test_sites_of_other_joints_take_none_by_name():
    sites = [excavator(), soilvdb.Site(0.1, soilvdb.plane(0.0), [
        soilvdb.Machine(soilvdb.Bucket(1, 1), "digger")])]
    before = [site.save() for site in sites]
    with pytest.raises(ValueError, match="site 1 has other joints than site 0"):
        soilvdb.update_many(sites, "digger", joints={name: [0.0, 0.0] for name in JOINTS})
    assert [site.save() for site in sites] == before


def test_a_machine_without_joints_refuses_them_by_name():
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Machine(soilvdb.Bucket(1, 1), "digger")])
    for call in (site.update, site.place, site.update_path,
                 lambda machine, joints: soilvdb.update_many([site], machine, joints=joints),
                 soilvdb.VectorSite(site, 1).step):
        with pytest.raises(soilvdb.StateError, match="joints: the machine has none") as told:
            call("digger", joints={"boom": [0.0]})
        assert told.value.machine == "digger"
