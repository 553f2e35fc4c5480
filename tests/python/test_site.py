# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A site fed from Python is the program's, to the bit, and refuses what can't be."""

import copy
import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import soilvdb

LONG = "SOILVDB_LONG" in os.environ  # tools/test --long

PROGRAM = Path(soilvdb.__file__).parents[2] / "soilvdb"
PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
LOAM = soilvdb.Soil(repose_angle=0.61, swell=0.25)


def bucket():
    return soilvdb.Bucket(width=1.2, height=0.9, profile=PROFILE)


def make_site(soil=None, voxel_size=0.1):
    return soilvdb.Site(voxel_size, soilvdb.plane(0.0), [bucket()], soil=soil)


def dig(steps=60):
    """Positions (N, 3) and rotations (N, 4) of a drag that curls up."""
    s = np.linspace(0, 1, steps)
    pitch = 0.35 - 1.9 * np.clip((s - 0.7) / 0.3, 0, 1)
    down = np.clip(s / 0.15, 0, 1)
    positions = np.stack(
        [-3 + 4 * s, 0 * s, 0.3 - 0.8 * down + 1.5 * np.clip((s - 0.8) / 0.2, 0, 1)], axis=1)
    zero = 0 * s
    return positions, np.stack([zero, np.sin(pitch / 2), zero, np.cos(pitch / 2)], axis=1)


@pytest.fixture(params=[None, LOAM], ids=["rigid", "moving"])
def soil(request):
    return request.param


def test_digs_a_box_of_known_volume():
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(width=1.0, height=0.5)])
    for x in np.linspace(0, 2, 21):
        update = site.update(0, position=(x, 0, -0.2))
    assert update.bucket_m3 == pytest.approx(0.4, rel=2e-3)
    assert site.change_m3() == pytest.approx(-0.4, rel=2e-3)
    heights = site.heights([(1.0, 0.0), (1.0, 0.45), (1.0, 3.0)])
    assert heights == pytest.approx([-0.2, -0.2, 0.0], abs=0.01)


def test_all_forms_of_a_pose_and_of_a_path_give_the_same_bits(soil):
    positions, rotations = dig()
    sites = [make_site(soil) for _ in range(4)]
    matrices = np.tile(np.eye(4), (len(positions), 1, 1))
    for i, (p, (x, y, z, w)) in enumerate(zip(positions, rotations)):
        matrices[i, :3, :3] = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
        matrices[i, :3, 3] = p
    loads = [sites[0].update(0, position=tuple(p), rotation=list(q)).bucket_m3
             for p, q in zip(positions, rotations)]
    for p, q in zip(positions, rotations):
        sites[1].update("machine 0", position=p, rotation=q)
    given = sites[2].update_path(0, positions=positions, rotations=rotations)
    sites[3].update_path(0, poses=matrices)
    assert (given["bucket_m3"] == loads).all()
    assert sites[0].save() == sites[1].save() == sites[2].save()
    assert sites[3].change_m3() == pytest.approx(sites[0].change_m3(), rel=1e-3)
    assert max(loads) > 0.5


def test_is_the_programs_ground_to_the_bit(tmp_path):
    positions, rotations = dig(40)
    rows = ["time,x,y,z,qx,qy,qz,qw"]
    rows += [",".join(repr(float(v)) for v in (i, *p, *q))
             for i, (p, q) in enumerate(zip(positions, rotations))]
    (tmp_path / "dig.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "s.yaml").write_text(
        "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 0}}\nmachines:\n- name: digger\n"
        "  motion: dig.csv\n  bucket: {width: 1.2, height: 0.9, profile: %s}\n"
        % json.dumps(PROFILE))
    summary = soilvdb.run(tmp_path / "s.yaml", out=tmp_path / "out", mesh=False)
    site = soilvdb.Site.open(str(tmp_path / "s.yaml"))
    site.update_path("digger", positions=positions, rotations=rotations)
    assert f"{site.ground_hash():016x}" == summary["state_hash"]
    assert site.ledger()["cut_m3"] == pytest.approx(summary["volume_m3"]["cut"], abs=1e-12)
    again = soilvdb.Site(0.1, soilvdb.snapshot(str(tmp_path / "out" / "soil_final.vdb")), [bucket()])
    assert again.ground_hash() == site.ground_hash()
    site.write(str(tmp_path / "now.vdb"))
    diff = subprocess.run([PROGRAM, "diff", tmp_path / "now.vdb", tmp_path / "out/soil_final.vdb",
                           "--json"], capture_output=True, check=True)
    assert json.loads(diff.stdout)["cut_m3"] == 0


def test_goes_on_from_bytes_pickles_and_clones(soil):
    positions, rotations = dig()
    whole, first = make_site(soil), make_site(soil)
    whole.update_path(0, positions=positions, rotations=rotations)
    first.update_path(0, positions=positions[:30], rotations=rotations[:30])
    other = make_site(soil)
    other.restore(first.save())
    for site in (other, first.clone(), pickle.loads(pickle.dumps(first)), first):
        site.update_path(0, positions=positions[30:], rotations=rotations[30:])
        assert site.save() == whole.save()


def test_pickles_of_all_kinds_of_sites():
    site = soilvdb.Site(
        0.1, soilvdb.plane(1.0, slope=(0.1, 0)),
        [soilvdb.Machine(bucket(), "digger"), soilvdb.Bucket(1.0, 0.6, dump_angle=0.8)],
        soil=soilvdb.Soil(0.6, 0.2, 1900, 5000, 0.5),
        pours=[soilvdb.Pour((2, 2, 5), 1.0, (0, 10), "truck")],
        hoppers=[soilvdb.Hopper((5, 5, 7, 7), 2.0), soilvdb.Hopper((9, 5, 11, 7), 2.0, (0, 5))])
    site.pour(20)
    same = pickle.loads(pickle.dumps(site))
    assert same.save() == site.save()
    assert same.machines == ["digger", "machine 1"]
    assert same.change_m3() == pytest.approx(1.0, rel=1e-3)


def test_a_tool_of_any_shape_digs_and_pickles(tmp_path):
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv 0.4 0 0\nv 0 0.8 0\nv 0 0 0.5\n"
                                        "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    wedge = soilvdb.tool(tmp_path / "wedge.obj", voxel=0.02)
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [wedge])
    same = pickle.loads(pickle.dumps(site))
    turned = (0, 0, 0, 1)
    for one in (site, same):
        one.update(0, position=(0, 0, -1.0), rotation=turned)
    assert site.change_m3() == same.change_m3() == pytest.approx(-0.4 * 0.8 * 0.5 / 6, rel=0.02)
    with pytest.raises(ValueError, match="isn't closed"):
        (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
        soilvdb.tool(tmp_path / "open.obj", 0.1)


@pytest.mark.parametrize("sent", [lambda thing: pickle.loads(pickle.dumps(thing)), copy.copy,
                                  copy.deepcopy], ids=["pickle", "copy", "deepcopy"])
def test_what_a_site_gives_and_takes_can_be_sent_to_another_process(sent):
    site = make_site(soilvdb.Soil(0.6))
    positions, rotations = dig()
    site.update_path(0, positions=positions, rotations=rotations)
    patches = site.changed_patches()
    assert len(patches) > 1
    for patch, same in zip(patches, sent(patches), strict=True):
        assert same.block == patch.block and type(same.block) is tuple
        for a, b in ((same.points, patch.points), (same.triangles, patch.triangles)):
            assert a.dtype == b.dtype and a.shape == b.shape and (a == b).all()
    update = site.update(0, position=positions[0])
    same = sent(update)
    for name in ("cut_m3", "bucket_m3", "spilled_m3", "slid_m3", "us"):
        assert getattr(same, name) == getattr(update, name)
    assert update.spilled_m3 > 0 and repr(same) == repr(update)
    assert sent(site.ledger()) == site.ledger()
    assert sent(site).save() == site.save()
    assert sent(soilvdb.Machine(bucket(), "digger")).name == "digger"
    for thing in (bucket(), soilvdb.plane(1.0, (0.1, 0)), soilvdb.Soil(0.6),
                  soilvdb.raster("site.tif"), soilvdb.snapshot("a.vdb"),
                  soilvdb.Pour((0, 0, 5), 1.0, (0, 10)), soilvdb.Hopper((5, 5, 7, 7), 2.0)):
        assert sent(thing).__reduce_ex__(2)[2] == thing.__reduce_ex__(2)[2]
    with pytest.raises(soilvdb.NoGroundError, match="no ground"):
        raise sent(soilvdb.NoGroundError("no ground"))


def test_a_copy_of_a_site_goes_on_by_itself():
    site = make_site()
    other = copy.copy(site)
    other.update(0, position=(0, 0, -0.3))
    assert other.update(0, position=(1, 0, -0.3)).cut_m3 > 0
    assert site.ledger()["cut_m3"] == 0


def test_patches_hold_the_surface_and_are_pythons_own():
    site = make_site()
    positions, rotations = dig()
    patches = {}
    for i in range(0, 60, 20):
        site.update_path(0, positions=positions[i:i + 20], rotations=rotations[i:i + 20])
        patches.update({p.block: p for p in site.changed_patches()})
    assert not site.changed_patches()
    points, triangles = site.mesh()
    assert points.dtype == np.float64 and triangles.dtype == np.uint32
    assert sum(len(p.triangles) for p in patches.values()) == len(triangles)
    before = points.copy()
    site.update(0, position=(0, 1, -0.5))
    site.close()
    assert (points == before).all()
    assert points.flags.owndata or points.base is None


def test_many_sites_step_at_once_as_one_by_one():
    positions, _ = dig(20)
    start = make_site()
    sites = [start.clone() for _ in range(6)]
    offsets = np.arange(6)[:, None] * [0, 0, -0.02]
    for p in positions:
        soilvdb.update_many(sites, 0, positions=p + offsets)
    for site, offset in zip(sites, offsets):
        alone = start.clone()
        alone.update_path(0, positions=positions + offset)
        assert alone.save() == site.save()
    with pytest.raises(ValueError, match="a site is there twice"):
        soilvdb.update_many([start, start], 0, positions=np.zeros((2, 3)))


BAD = [
    (dict(position=(0, 0)), ValueError, r"position has 2 numbers; it must have 3"),
    (dict(position=(0, 0, "a")), TypeError, r"position must be numbers, not str"),
    (dict(position=np.zeros((3, 1))), ValueError, r"position has the shape \(3, 1\); it must be \(3,\)"),
    (dict(position=np.zeros(3, complex)), TypeError, r"position must be numbers, not an array of complex128"),
    (dict(position=(0, 0, float("nan"))), ValueError, r"machine 'machine 0': the position is \(0, 0, nan\) m; it must be finite"),
    (dict(position=(0, 0, 0), rotation=(1, 1, 1, 1)), ValueError, r"quaternion of length 2; it must be of length 1"),
    (dict(position=(0, 0, 0), rotation=(0, 0, 1)), ValueError, r"rotation has 3 numbers"),
    (dict(pose=np.zeros((4, 4))), ValueError, r"pose is not a rigid transform"),
    (dict(pose=np.eye(3)), ValueError, r"pose has the shape \(3, 3\); it must be \(N, 4\)"),
    (dict(pose=np.eye(4), position=(0, 0, 0)), TypeError, r"either pose or position"),
    (dict(joints=[0.1]), ValueError, r"machine 'machine 0' has no joints; give it a pose"),
    (dict(), TypeError, r"position, pose or joints are missing"),
    (dict(position=(0, 0, 0), time=-1.0), ValueError, r"time goes back from 5 s to -1 s"),
    (dict(position=(1e9, 0, 0)), ValueError, r"would move 1e\+09 m in one state; are these metres"),
    (dict(position=(0, 0, 0), time=float("nan")), ValueError, r"time must be finite"),
    (dict(position=[0, 0, np.complex128(1j)]), TypeError, r"must be numbers, not complex128"),
]


def test_a_clock_that_was_ahead_is_set(soil):
    site, other = make_site(soil), make_site(soil)
    for each, time in ((site, 5.0), (other, 0.5)):
        each.update(0, position=(0, 0, -0.2), time=time)
    site.reset_clock(0)
    for each in (site, other):
        each.update(0, position=(0.5, 0, -0.2), time=1.0)
    assert site.ground_hash() == other.ground_hash()
    with pytest.raises(ValueError, match="time goes back from 1 s to 0.5 s"):
        site.update(0, position=(0, 0, -0.2), time=0.5)
    with pytest.raises((ValueError, IndexError)):
        site.reset_clock(7)


@pytest.mark.parametrize("arguments, error, message", BAD)
def test_bad_states_raise_and_change_nothing(soil, arguments, error, message):
    site = make_site(soil)
    site.update(0, position=(0, 0, -0.2), time=5.0)
    before = site.save()
    with pytest.raises(error, match=message):
        site.update(0, **arguments)
    assert site.save() == before
    for machine in (-1, 1, 2**62):
        with pytest.raises(ValueError, match="there is no machine"):
            site.update(machine, position=(0, 0, 0))
    with pytest.raises(ValueError, match="there is no machine 'x'; there are: machine 0"):
        site.update("x", position=(0, 0, 0))
    assert site.save() == before


@pytest.mark.parametrize("arguments, error, message", [
    (dict(joints=np.zeros((5, 0))), ValueError, r"joints must have the shape \(N, joints\)"),
    (dict(positions=[(0, 0, 0)], times=[np.nan]), soilvdb.StateError, "state 0: .* time must be finite"),
    (dict(poses=np.diag([1, 1, -1, 1])[None]), ValueError, "state 0: machine 'machine 0': pose is not a rigid transform"),
])
def test_bad_paths_raise_and_change_nothing(soil, arguments, error, message):
    site = make_site(soil)
    site.update(0, position=(3, 0, -0.2))
    before = site.save()
    with pytest.raises(error, match=message):
        site.update_path(0, **arguments)
    assert site.save() == before


def test_a_path_says_which_matrix_is_none():
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[2, 0, 0] = 5
    with pytest.raises(ValueError, match="state 2: machine 'machine 0': pose is not a rigid"):
        make_site().update_path(0, poses=poses)


def test_sites_of_a_generator_live_as_long_as_they_are_stepped():
    site = make_site()
    updates = soilvdb.update_many((site.clone() for _ in range(4)), 0, positions=np.zeros((4, 3)))
    assert len(updates) == 4
    for sites in ([1], [None], [site, object()]):
        with pytest.raises(TypeError, match="each of sites must be soilvdb.Site, not"):
            soilvdb.update_many(sites, 0, positions=np.zeros((len(sites), 3)))


def test_a_list_that_changes_while_it_is_read_is_refused():
    class Number:
        def __float__(self):
            given.clear()
            return 1.0

    given = [Number(), 0.0, 0.0]
    with pytest.raises(ValueError, match="position changed while it was read"):
        make_site().update(0, position=given)


def test_a_site_keeps_no_array_or_list_of_the_callers():
    near, machines = np.zeros(3), [bucket()]
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), machines, near=near)
    near[:] = 1e6
    machines.append(bucket())
    assert pickle.loads(pickle.dumps(site)).save() == site.save()


def test_a_bucket_says_what_it_holds():
    assert soilvdb.Bucket(1.0, 0.5).capacity is None
    struck, heaped = soilvdb.Bucket(2.0, 1.0, [(0, 0), (-1, 0), (-1, 1), (0, 1)]).capacity
    assert struck == pytest.approx(2.0), "a box of 2 m x 1 m x 1 m"
    assert heaped == pytest.approx(2.0 + 1 / 4 + 1 / 6), "a hipped roof of 2 m x 1 m at 1:1"


def box_mesh(file):
    """A box of 2 m x 1 m x 1 m without thickness, in mm, that is open towards -y and has its lip on x."""
    corners = [(x, y, z) for x in (-1000, 1000) for y in (0, 1000) for z in (0, 1000)]
    faces = [(1, 2, 4, 3), (5, 6, 8, 7), (1, 3, 7, 5), (2, 4, 8, 6), (3, 4, 8, 7)]
    file.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) +
                    "".join(f"f {' '.join(map(str, face))}\n" for face in faces))
    return [(-1000, 0, 0), (1000, 0, 0)]


@pytest.mark.parametrize("upper", [None, (300, 0, 1000)])
def test_a_bucket_is_made_of_a_mesh(tmp_path, upper):
    lip = box_mesh(tmp_path / "box.obj")
    given = {"lip": np.array(lip), "unit": 0.001, "upper": upper}
    made = soilvdb.Bucket.from_mesh(tmp_path / "box.obj", **given, dump_angle=1.0)
    assert (made.width, made.height, made.dump_angle) == pytest.approx((2.0, 1.0, 1.0), rel=5e-3)
    assert made.capacity[0] == pytest.approx(2.0, rel=5e-3)
    pose = soilvdb.Bucket.pose_in_mesh(tmp_path / "box.obj", **given)
    assert pose == pytest.approx(np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))


def real_bucket(file, taper, thick=25.0, teeth=5):
    """A bucket as builders have them, in mm, turned and off the origin: plates with thickness, sides
    that taper towards the back, teeth. Returns its lip, and its struck volume by Green's theorem, m3."""
    width, depth, height = 1100.0, 800.0, 850.0
    t = np.linspace(0, np.pi, 40)[:, None]
    side = np.hstack([-depth * np.sin(t)**0.8, height * (1 - np.cos(t)) / 2])
    side[0], side[-1] = (0, 0), (0, height)
    out = np.array([(-depth / 2, height / 2)]) + (side - (-depth / 2, height / 2)) * (
        1 + 2 * thick / depth, 1 + 2 * thick / height)
    out[0], out[-1] = (0, -thick), (0, height + thick)

    def half(x):
        return width / 2 * (1 + taper * x / depth)

    points, faces = [], []

    def add(*corners):
        faces.append(range(len(points) + 1, len(points) + 1 + len(corners)))
        points.extend(corners)

    for line, more in ((side, 0.0), (out, thick)):
        for (x, z), (u, w) in zip(line, line[1:]):
            a, b = half(x) + more, half(u) + more
            add((x, -a, z), (x, a, z), (u, b, w), (u, -b, w))
            for sign in (-1, 1):  # a fan of the side plate
                add((x, sign * a, z), (u, sign * b, w), (0, sign * (half(0) + more), height / 2))
    for sign in (-1, 1):  # the rim
        y = half(0)
        add((0, sign * y, 0), (0, sign * y, height), (0, sign * (y + thick), height + thick),
            (0, sign * (y + thick), -thick))
        z = 0 if sign < 0 else height
        add((0, -y, z), (0, y, z), (0, y + thick, z + sign * thick), (0, -y - thick, z + sign * thick))
    for k in range(teeth):
        y = (k - (teeth - 1) / 2) * width / teeth
        for z in (0, -thick):
            add((0, y - 40, z), (150, y - 40, z), (150, y + 40, z), (0, y + 40, z))
        for x, u, a, b in ((0, 150, -40, -40), (150, 150, -40, 40), (150, 0, 40, 40)):
            add((x, y + a, 0), (u, y + b, 0), (u, y + b, -thick), (x, y + a, -thick))
    (x, z), (u, w) = side.T, np.roll(side, -1, axis=0).T
    cross = (x * w - u * z) / 2
    struck = abs(width * (cross + taper / depth * cross * (x + u) / 3).sum()) * 1e-9
    axis = np.array([0.36, 0.48, 0.8])
    wide = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(0.9) * wide + (1 - np.cos(0.9)) * wide @ wide
    file.write_text("".join("v {:.6f} {:.6f} {:.6f}\n".format(*p)
                            for p in np.array(points) @ turn.T + (500, -300, 200)) +
                    "".join(f"f {' '.join(map(str, face))}\n" for face in faces))
    return np.array([(0, -width / 2, 0), (0, width / 2, 0)]) @ turn.T + (500, -300, 200), struck, turn


@pytest.mark.parametrize("taper", [0.0, 0.12])
def test_a_real_buckets_mesh_holds_its_struck_volume(tmp_path, taper):
    lip, struck, turn = real_bucket(tmp_path / "real.obj", taper)
    given = {"lip": lip, "unit": 0.001}
    made = soilvdb.Bucket.from_mesh(tmp_path / "real.obj", **given)
    assert made.capacity[0] == pytest.approx(struck, rel=0.02)
    assert made.height == pytest.approx(0.85, rel=0.02)
    assert made.width == pytest.approx(1.1, rel=0.005 + taper)
    pose = soilvdb.Bucket.pose_in_mesh(tmp_path / "real.obj", **given)
    assert pose[:3, 3] == pytest.approx((0.5, -0.3, 0.2), abs=0.005)
    assert pose[:3, :3] == pytest.approx(turn, abs=0.01)


def test_a_dae_takes_its_lip_in_metres(tmp_path):
    """Its unit is told there: here it is the centimetre."""
    lip = np.array(box_mesh(tmp_path / "box.obj")) / 1000
    words = [line.split() for line in (tmp_path / "box.obj").read_text().splitlines()]
    points = [str(float(n) / 10) for word in words if word[0] == "v" for n in word[1:]]
    faces = [str(int(n) - 1) for word in words if word[0] == "f" for n in word[1:]]
    file = tmp_path / "box.dae"
    file.write_text(
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        '<asset><unit meter="0.01"/><up_axis>Z_UP</up_axis></asset>'
        '<library_geometries><geometry id="g"><mesh><source id="p">'
        f'<float_array id="a" count="{len(points)}">{" ".join(points)}</float_array><technique_common>'
        '<accessor source="#a" count="8" stride="3"/></technique_common></source>'
        '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><polylist count="5">'
        '<input semantic="VERTEX" source="#v" offset="0"/><vcount>4 4 4 4 4</vcount>'
        f'<p>{" ".join(faces)}</p></polylist></mesh></geometry></library_geometries></COLLADA>')
    for upper in (None, (0.3, 0, 1)):
        made = soilvdb.Bucket.from_mesh(file, lip=lip, upper=upper)
        assert (made.width, made.height) == pytest.approx((2.0, 1.0), rel=5e-3)
    pose = soilvdb.Bucket.pose_in_mesh(file, lip=lip)
    assert pose == pytest.approx(np.array([[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    for given, message in [
            ({"lip": 100 * lip, "unit": 0.01},
             "says its unit itself; leave out the unit of 0.01, and give lip and upper in metres"),
            ({"lip": 100 * lip}, "the lip is 200 m long; of a .dae it must be in metres"),
            ({"lip": lip - (0, 0.5, 0)}, r"mesh is \(-1, 0, 0\), in metres")]:
        with pytest.raises(ValueError, match=f"box.dae: .*{message}"):
            soilvdb.Bucket.from_mesh(file, **given)


@pytest.mark.parametrize("change, message", [
    ({"file": "bucket.ply"}, "bucket.ply: is not a readable mesh; use .stl, .obj or .dae"),
    ({"file": "bucket.dae"}, "bucket.dae: has no triangles"),
    ({"file": "none.obj"}, "none.obj: "),
    ({"file": "text.obj"}, "text.obj: has no triangles"),
    ({"lip": [(0, 0, 0)]}, "lip has 1 points; it must be the 2 ends (x, y, z) of the cutting edge"),
    ({"lip": [(0, 0), (1, 1)]}, "lip"),
    ({"lip": [(-1000, 0, 500), (1000, -200, 0)]}, "box.obj: lip has the point (1000, -200, 0), which is "
     "0.2 m off the mesh; the nearest point of the mesh is (1000, 0, 0)"),
    ({"unit": 1.0}, "box.obj: the lip is 2e+03 m long with a unit of 1; unit must be the metres per "),
    ({"upper": (0, 1000, 1000), "lip": [(-1000, 0, 0), (1000, 1000, 0)]}, "box.obj: "),
])
def test_a_mesh_that_is_no_bucket_is_told_in_one_line(tmp_path, monkeypatch, change, message):
    monkeypatch.chdir(tmp_path)
    given = {"file": "box.obj", "lip": box_mesh(tmp_path / "box.obj"), "unit": 0.001, **change}
    (tmp_path / "text.obj").write_text("hello\n")
    (tmp_path / "bucket.dae").write_text("<COLLADA/>\n")
    (tmp_path / "bucket.ply").write_text("ply\n")
    with pytest.raises(ValueError) as told:
        soilvdb.Bucket.from_mesh(**given)
    assert str(told.value).startswith(message) and "\n" not in str(told.value)


PLANE = soilvdb.plane(0.0)


@pytest.mark.parametrize("call, message", [
    (lambda s: s.update(0, postion=(0, 0, 0)),
     "update() has no argument 'postion'; it has machine, position, rotation, pose, joints, base, time"),
    (lambda s: s.update(0, (0, 0, 0)), "update() takes 'position' by name"),
    (lambda s: s.update(1.5, position=(0, 0, 0)), "machine must be int or str, not float"),
    (lambda s: s.update(0, position=(0, 0, 0), time="a"), "time must be float or None, not str"),
    (lambda s: s.heights(), "heights() misses 'xy'; it takes (xy, sigma, ceiling)"),
    (lambda s: s.heights([(0, 0)], ceiling="a"), "ceiling must be float or None, not str"),
    (lambda s: s.height_map(shape=(2, 2), cell=0.1), "give one of machine, pose or origin"),
    (lambda s: s.height_map(origin=(0, 0), machine=0, shape=(2, 2), cell=0.1),
     "give one of machine, pose or origin"),
    (lambda s: s.height_map(origin=(0, 0), cell=0.1), "height_map() misses 'shape'; it takes "
     "(machine, origin, pose, shape, cell, turned, layer, ceiling, design, out)"),
    (lambda s: s.record(5), "folder must be path, not int"),
    (lambda s: s.record("x", sync="1"), "sync must be float or None, not str"),
    (lambda s: s.restore("x"), "state must be bytes, not str"),
    (lambda s: soilvdb.Site(0.1, 0.0, []), "terrain must be Terrain, not float"),
    (lambda s: soilvdb.Site("a", PLANE, []), "voxel_size must be float, not str"),
    (lambda s: soilvdb.Site(0.1, PLANE, bucket()),
     "machines must be a list of soilvdb.Bucket or soilvdb.Machine, not Bucket"),
    (lambda s: soilvdb.Site(0.1, PLANE, [3]),
     "each of machines must be soilvdb.Bucket or soilvdb.Machine, not int"),
    (lambda s: soilvdb.Site(0.1, PLANE, [], pours=[3]), "each of pours must be soilvdb.Pour, not int"),
    (lambda s: soilvdb.update_many(s, 0, positions=[]),
     "sites must be a list of soilvdb.Site, not Site"),
    (lambda s: soilvdb.update_many([s], 0),
     "give one of positions (with rotations), poses or joints"),
    (lambda s: soilvdb.update_many([s], 0, positions=np.zeros((1, 3)), time=1.0, times=[1.0]),
     "give either time or times"),
    (lambda s: s.heights(np.zeros((2, 2), complex)), "xy must be numbers, not an array of complex128"),
    (lambda s: soilvdb.Site.update(3, 0), "self must be Site, not int"),
    (lambda s: s.mesh(1), "mesh() takes no more arguments than ()"),
    *[(lambda s, shape=shape: s.height_map(origin=(0, 0), shape=shape, cell=0.1),
       f"shape must be (ny, nx), two whole numbers, not {shown}") for shape, shown in [
           (3, "3"), ((3.0, 3.0), "(3.0, 3.0)"), ("33", "'33'"), ((True, 3), "(True, 3)"),
           (np.array(3), "array(3)"), (np.ones((2, 30), int), "ndarray")]],
])
def test_wrong_calls_are_told_in_one_line(call, message):
    with pytest.raises(TypeError) as told:
        call(make_site())
    assert str(told.value) == message


@pytest.mark.parametrize("call, message", [
    (lambda s: s.height_map(origin=(0, 0), shape=(2, 0), cell=0.1),
     "shape is (2, 0); each must be from 1 to 65536"),
    (lambda s: s.height_map(origin=(0, 0), shape=(2, 65537), cell=0.1),
     "shape is (2, 65537); each must be from 1 to 65536"),
    (lambda s: s.height_map(origin=(0, 0), shape=(3,), cell=0.1),
     "shape must be (ny, nx), two whole numbers, not (3,)"),
    (lambda s: soilvdb.VectorSite(s, 1).height_map(origin=(0, 0), shape=(3, 3, 3), cell=0.1),
     "shape must be (ny, nx), two whole numbers, not (3, 3, 3)"),
    (lambda s: s.height_map(origin=(0, 0), shape=(2, 2), cell=-1.0),
     "a map's cells must be from a thousandth of a voxel to 1024 voxels wide"),
    (lambda s: s.height_map(origin=(0, 0), shape=(2, 2), cell=0.1, layer="depth"),
     "layer is 'depth'; it must be 'height', 'loose', 'dug' or 'design'"),
    *[(lambda s, out=out: s.height_map(origin=(0, 0), shape=(2, 2), cell=0.1, out=out),
       "out must be a writable C-contiguous array of float32 or float64 with the shape (2, 2); "
       f"this one {fault}") for out, fault in [
           (np.zeros((2, 2), int), "has the type int64"),
           (np.zeros((2, 2), ">f4"), "has the type >f4"),
           (np.zeros((2, 2), np.float16), "has the type float16"),
           (np.zeros((2, 3)), "has the shape (2, 3)"),
           (np.zeros(4), "has the shape (4,)"),
           (np.zeros((4, 2))[::2], "is not C-contiguous"),
           (np.zeros((2, 2), order="F"), "is not C-contiguous"),
           (np.frombuffer(bytearray(33), np.uint8)[1:].view(float).reshape(2, 2), "is not aligned"),
           (np.frombuffer(bytes(32)).reshape(2, 2), "is read-only"),
           (np.ma.zeros((2, 2)), "is a masked array"),
           ([0, 0], "is a list")]],
    (lambda s: s.height_map(machine=0, shape=(2, 2), cell=0.1),
     "machine 'machine 0' has no place before its first state, by update() or place()"),
    (lambda s: s.height_map(machine=3, shape=(2, 2), cell=0.1),
     "there is no machine 3; there are 1, numbered from 0"),
    (lambda s: soilvdb.height_maps([s, s.clone()], machine=3, shape=(2, 2), cell=0.1),
     "site 0: there is no machine 3; there are 1, numbered from 0"),
    (lambda s: soilvdb.height_maps([s], machine=0, shape=(2, 2), cell=-1.0),
     "site 0: a map's cells must be from a thousandth of a voxel to 1024 voxels wide"),
    (lambda s: soilvdb.height_maps([s], machine=0, shape=(2, 2), cell=0.1, layer="design"),
     "site 0: a map of heights above a design needs the design"),
    (lambda s: soilvdb.height_maps([s], pose=np.zeros((1, 4, 4)), shape=(2, 2), cell=0.1),
     "site 0: pose is not a rigid transform; it needs a rotation, a position and a last row of 0 0 0 1"),
    (lambda s: soilvdb.height_maps([s], pose=np.zeros((2, 4, 4)), shape=(2, 2), cell=0.1),
     "pose has the shape (2, 4, 4); it must be (4, 4) or (1, 4, 4)"),
    (lambda s: s.height_map(pose=np.zeros((1, 4, 4)), shape=(2, 2), cell=0.1),
     "pose has the shape (1, 4, 4); it must be (N, 4)"),
    (lambda s: s.heights([(0, 0)], ceiling=np.nan), "a ceiling must be a number"),
    (lambda s: s.heights([(0, 0)], sigma=True, ceiling=1.0),
     "sigma is that of the surface without a ceiling; give either sigma or ceiling"),
    (lambda s: soilvdb.height_maps([s, s], machine=0, shape=(2, 2), cell=0.1),
     "a site is there twice"),
])
def test_maps_that_cant_be_are_told_in_one_line(call, message):
    with pytest.raises(ValueError) as told:
        call(make_site())
    assert str(told.value) == message


def test_a_shape_is_of_any_whole_numbers():
    site = make_site()
    for shape in ([2, 3], np.array([2, 3]), (np.int8(2), 3), iter((2, 3))):
        assert site.height_map(origin=(0, 0), shape=shape, cell=0.1).shape == (2, 3)


def test_states_that_no_pickle_made_are_refused():
    machine = soilvdb.Machine(bucket(), "digger")
    state = machine.__reduce_ex__(2)[2]
    for at, turn in (([], []), ([1.0], [1.0]), (state[4], []), (None, None)):
        with pytest.raises((RuntimeError, TypeError)):
            soilvdb.Machine.__new__(soilvdb.Machine).__setstate__((*state[:4], at, turn))
    for kind, wrong in ((soilvdb.Update, (1.0,)), (soilvdb.Update, ("a",) * 5), (soilvdb.Patch, ()),
                        (soilvdb.Patch, ((0, 0, 0), "points", "triangles"))):
        with pytest.raises((RuntimeError, TypeError, ValueError)):
            kind.__new__(kind).__setstate__(wrong)


def test_bad_sites_bytes_and_arrays_raise():
    for voxel_size in (0, -1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="voxel size"):
            make_site(voxel_size=voxel_size)
    with pytest.raises(ValueError):
        soilvdb.Bucket(width=-1, height=1)
    with pytest.raises(ValueError, match="angle of repose"):
        soilvdb.Soil(2.0)
    with pytest.raises(ValueError, match="35 degrees are 0.611"):
        soilvdb.Soil(35)
    with pytest.raises(ValueError, match="swell is 25; it must be .* from 0 to 3"):
        soilvdb.Soil(0.6, swell=25)
    with pytest.raises(ValueError, match="/no.tif"):
        soilvdb.Site(0.1, soilvdb.raster("/no.tif"), [bucket()])
    site = make_site()
    for state in (b"", b"x" * 100, site.save()[:-3]):
        with pytest.raises(ValueError):
            site.restore(state)
    for xy in (np.zeros(3), np.zeros((2, 3)), "a", [["a", "b"]], None, np.zeros((2, 2), object)):
        with pytest.raises((ValueError, TypeError)):
            site.heights(xy)
    assert np.isnan(site.heights(np.full((2, 2), np.nan))).all()
    assert site.heights(np.empty((0, 2))).shape == site.heights([]).shape == (0,)
    with pytest.raises(ValueError, match="y.tif: a session writes a snapshot; its name must end with .vdb"):
        site.write("y.tif")


def test_heights_take_any_layout():
    site = make_site()
    site.update_path(0, positions=dig()[0])
    xy = np.random.default_rng(1).uniform(-4, 4, (300, 2))
    wanted = site.heights(xy)
    read_only = xy.copy()
    read_only.setflags(write=False)
    unaligned = np.zeros(xy.nbytes + 1, np.uint8)[1:].view(float).reshape(xy.shape)
    unaligned[:] = xy
    assert not unaligned.flags.aligned
    for same in (np.asfortranarray(xy), np.repeat(xy, 2, axis=0)[::2], read_only, xy.tolist(),
                 xy.astype(">f8"), unaligned):
        assert (site.heights(same) == wanted).all()


def test_maps_are_the_ledger_and_go_with_the_machine(soil):
    site = make_site(soil)
    positions = dig()[0]  # without a turn it makes no roof
    unlooked = make_site(soil)
    kept = np.empty((80, 120), np.float32)
    for position in positions:
        site.update(0, position=position)
        unlooked.update(0, position=position)
        dug = site.height_map(origin=(-6, -4), shape=(80, 120), cell=0.1, layer="dug")
        assert dug.sum() * 0.1**2 == pytest.approx(-site.change_m3(), abs=1e-9)
        assert site.height_map(origin=(-6, -4), shape=(80, 120), cell=0.1, out=kept) is kept
        assert kept == pytest.approx(-dug, abs=0.01), "the terrain is a plane at 0, by counts"
    assert site.save() == unlooked.save() and site.ground_hash() == unlooked.ground_hash()
    assert dug.dtype == np.float64
    around = site.height_map(machine=0, shape=(5, 9), cell=0.1)
    lip = positions[-1]
    cells = [[lip[:2] + (0.1 * (j - 4), 0.1 * (i - 2)) for j in range(9)] for i in range(5)]
    assert around == pytest.approx(site.heights(np.reshape(cells, (-1, 2))).reshape(5, 9), abs=0.03)
    matrix = np.eye(4)
    matrix[:3, 3] = lip
    assert (site.height_map(pose=matrix, shape=(5, 9), cell=0.1) == around).all()
    turn = np.array([[0, -1, 0, lip[0]], [1, 0, 0, lip[1]], [0, 0, 1, lip[2]], [0, 0, 0, 1.0]])
    turned = site.height_map(pose=turn, shape=(9, 5), cell=0.1)
    level = site.height_map(pose=turn, shape=(5, 9), cell=0.1, turned=False)
    assert level == pytest.approx(around, abs=0)
    assert turned == pytest.approx(around.T[::-1], abs=0.03), "ahead is world y, left is -x"
    assert (site.height_map(origin=(0, 0), shape=(2, 2), cell=0.1, ceiling=-3.0) <= -2.9).all()


def test_maps_of_many_sites_are_those_of_each(soil):
    sites = [make_site(soil) for _ in range(5)]
    for n, site in enumerate(sites):
        site.update_path(0, positions=dig()[0] + (0.1 * n, 0, 0), rotations=dig()[1])
    for given in ({"machine": 0}, {"origin": (-1, 1)}, {"machine": "machine 0", "turned": False}):
        every = soilvdb.height_maps(sites, shape=(6, 4), cell=0.2, layer="dug", **given)
        assert every.shape == (5, 6, 4)
        for site, one in zip(sites, every):
            assert (site.height_map(shape=(6, 4), cell=0.2, layer="dug", **given) == one).all()
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, :2, 3] = np.random.default_rng(2).uniform(-1, 2, (5, 2))
    poses[1, :2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    for given in (poses, poses[1]):
        every = soilvdb.height_maps(sites, pose=given, shape=(6, 4), cell=0.2)
        for site, pose, one in zip(sites, np.broadcast_to(given, (5, 4, 4)), every):
            assert (site.height_map(pose=pose, shape=(6, 4), cell=0.2) == one).all()
    fresh = make_site(soil)
    mixed = soilvdb.height_maps([sites[0], fresh, sites[1]], machine=0, shape=(6, 4), cell=0.2)
    assert np.isnan(mixed[1]).all() and np.isfinite(mixed[[0, 2]]).all()
    out = np.empty((5, 6, 4), np.float32)
    assert soilvdb.height_maps(sites, machine=0, shape=(6, 4), cell=0.2, out=out) is out
    assert np.isfinite(out).all()
    assert soilvdb.height_maps([], machine=0, shape=(6, 4), cell=0.2).shape == (0, 6, 4)


def test_sums_of_maps_are_the_volume_but_under_roofs_and_turned(soil):
    """As the docstrings have it."""
    site = make_site(soil)
    site.update_path(0, positions=dig()[0], rotations=dig()[1])
    if soil is None:  # a tunnel, whose roof holds
        for x in np.linspace(-4, 4, 90):
            site.update(0, position=(x, 2.5, -2.5))
    cells = {"origin": (-7.95, -7.95), "shape": (160, 160), "cell": 0.1, "layer": "dug"}
    sides = [(-6, -6), (6, -6), (6, 6), (-6, 6)]
    dug = site.height_map(**cells)
    assert site.volume(sides).net_m3 == pytest.approx(site.change_m3(), abs=1e-9)
    if soil is None:
        hidden = -site.change_m3() - dug.sum() * 0.01
        assert hidden > 1
        fresh = make_site()
        fresh.update_path(0, positions=dig()[0], rotations=dig()[1])
        site, dug = fresh, fresh.height_map(**cells)
    assert dug.sum() * 0.01 == pytest.approx(-site.change_m3(), abs=1e-9)
    turn = np.eye(4)
    turn[:2, :2] = [[0.8, -0.6], [0.6, 0.8]]
    turned = site.height_map(pose=turn, shape=(200, 200), cell=0.1, layer="dug").sum() * 0.01
    assert turned == pytest.approx(dug.sum() * 0.01, rel=0.05) and turned != dug.sum() * 0.01


def test_a_ceiling_is_to_the_voxel():
    site = make_site()
    for x in np.linspace(-4, 4, 90):  # a tunnel
        site.update(0, position=(x, 0, -2.5))
    at = {"origin": (0, 0), "shape": (1, 1), "cell": 0.1}
    assert site.height_map(**at) == 0
    floor = site.height_map(**at, ceiling=-1.9)[0, 0]
    assert -2.7 < floor < -2.4
    for ceiling in (-2.0, -2.04, -2.2):  # in the air of the tunnel: none of them cuts soil
        assert site.height_map(**at, ceiling=ceiling)[0, 0] == floor
    assert site.height_map(**at, ceiling=-3.0)[0, 0] == pytest.approx(-3.0, abs=0.1)
    assert site.height_map(**at, ceiling=-1.0)[0, 0] == pytest.approx(-1.0, abs=0.1), "in the roof"
    xy = [(0, 0), (0.03, 0.04), (0, 3)]
    assert site.heights(xy).tolist() == [0, 0, 0]
    below = site.heights(xy, ceiling=-1.9)
    assert below[0] == pytest.approx(floor, abs=1e-9) and below[1] == pytest.approx(floor, abs=0.05)
    assert below[2] == pytest.approx(-1.9, abs=0.1), "beside the tunnel"


def test_a_plane_in_utm_is_looked_at_where_work_will_begin():
    at = {"origin": (5e5, 5.4e6), "shape": (2, 3), "cell": 0.1}
    pose = np.eye(4)
    pose[:2, 3] = at["origin"]
    for look in (at, {"pose": pose, "shape": (2, 3), "cell": 0.1}):
        site = soilvdb.Site(0.05, soilvdb.plane(300.0), [bucket()])
        assert site.heights([at["origin"]]) == 300
        assert (site.height_map(**look) == 300).all()
        env = soilvdb.VectorSite(site, 2)
        assert (env.height_map(**look) == 300).all()
        for x in (5e5 - 2, 5e5 + 2):
            site.update(0, position=(x, 5.4e6, 299.9))
        assert site.height_map(**look) == pytest.approx(299.8, abs=0.01), "its body is 0.1 m lower than its lip"
        with pytest.raises(ValueError, match=r"which is at \(\d+, \d+\); `near` says where work begins"):
            site.height_map(origin=(0, 0), shape=(2, 3), cell=0.1)


def test_maps_above_a_design_are_what_is_to_be_done(soil):
    site = make_site(soil)
    site.update_path(0, positions=dig()[0], rotations=dig()[1])
    cells = {"origin": (-4, -2), "shape": (30, 60), "cell": 0.1}
    heights = site.height_map(**cells)
    x = -4 + 0.1 * np.arange(60)
    left = site.height_map(**cells, layer="design", design=soilvdb.plane(-0.4, (0.05, 0)))
    assert left == pytest.approx(heights - (-0.4 + 0.05 * x), abs=1e-9)
    assert (left > 0).any() and (left < 0.3).any()
    part = soilvdb.raster(np.full((5, 5), -0.4), origin=(-2, -1), cell=0.5)
    some = soilvdb.height_maps([site], **cells, layer="design", design=part)[0]
    assert np.isfinite(some).sum() == 21 * 20 and np.nanmin(some) < np.nanmax(some)
    with pytest.raises(ValueError, match="is for a map of heights above it"):
        site.height_map(**cells, design=part)


def test_looks_in_any_order_are_those_of_a_fresh_look(soil):
    random, site = np.random.default_rng(4), make_site(soil)
    for step, (p, q) in enumerate(zip(*dig(120))):
        site.update(0, position=p, rotation=q)
        at = p[:2] + random.uniform(-1.5, 1.5, 2)
        fresh = soilvdb.Site(0.1, soilvdb.plane(0.0), [bucket()], soil=soil)
        fresh.restore(site.save())
        for _ in range(3):
            kind = random.integers(4)
            if kind == 0:
                assert site.heights([at]) == fresh.heights([at])
            elif kind == 1:
                window = {"origin": at, "cell": random.choice([0.1, 0.07]), "layer": random.choice(
                    ["height", "loose", "dug"]), "shape": tuple(random.integers(1, 12, 2))}
                assert (site.height_map(**window) == fresh.height_map(**window)).all(), (step, window)
            elif kind == 2:
                assert (site.height_map(origin=at, shape=(3, 3), cell=0.1, ceiling=p[2] + 0.2) ==
                        fresh.height_map(origin=at, shape=(3, 3), cell=0.1, ceiling=p[2] + 0.2)).all()
            else:
                ways = random.normal(size=(20, 3)) - (0, 0, 1)
                assert (site.cast((*at, 2.0), ways) == fresh.cast((*at, 2.0), ways)).all()


def test_rays_meet_the_heights(soil):
    site = make_site(soil)
    site.update_path(0, positions=dig()[0], rotations=dig()[1])
    random = np.random.default_rng(6)
    ways = random.normal(size=(40, 30, 3)) * (1, 0.3, 0.3) - (0, 0, 0.6)
    ranges = site.cast((-4.0, 0.0, 1.5), ways)
    assert ranges.shape == (40, 30) and np.isinf(ranges).any()
    unit = ways / np.linalg.norm(ways, axis=2, keepdims=True)
    met = np.isfinite(ranges)
    hits = (-4.0, 0.0, 1.5) + ranges[met][:, None] * unit[met]
    above = hits[:, 2] - site.heights(hits[:, :2])
    assert np.quantile(np.abs(above), 0.9) < 1e-6 and (above < 1e-6).all()  # others end at a step
    assert (site.cast(np.broadcast_to((-4.0, 0.0, 1.5), ways.shape), 4 * ways) == ranges).all()
    assert site.cast((0, 0, -5), (1, 0, 0)) == 0 and site.cast((0, 0, 9), (0, 0, 1)) == np.inf
    for origins, directions, message in [
            ((0, 0, 1), (0, 0, 0), "ray 0: its direction must not be zero"),
            ((0, 0, 1), [(1, 0, 0), (0, np.nan, 0)], "ray 1: its direction must be numbers"),
            ((0, 0, 1), np.concatenate([np.tile((0, 0, 1.0), (1 << 20, 1)), np.zeros((2, 3))]),
             "^ray 1048576: its direction must not be zero"),
            ((0, 0), (0, 0, 1), r"origins must have the shape \(..., 3\)"),
            (np.zeros((2, 3)), np.ones((3, 3)), "or that of directions")]:
        with pytest.raises(ValueError, match=message):
            site.cast(origins, directions)


def test_looks_in_pieces_are_as_at_once():
    """Long looks handle signals between their pieces."""
    site = make_site()
    site.update_path(0, positions=dig()[0])
    xy = np.random.default_rng(9).uniform((-4, -2), (3, 2), (300_000, 2))
    heights = site.heights(xy)
    assert (heights == np.concatenate([site.heights(some) for some in np.array_split(xy, 5)])).all()
    assert heights.min() < -0.3 and heights.max() == 0
    where = {"origin": (-3.0 - 0.049, -0.6 - 0.049), "layer": "dug"}
    fine = site.height_map(shape=(1250, 4000), cell=0.002, **where)
    coarse = site.height_map(origin=(-3.0, -0.6), shape=(25, 80), cell=0.1, layer="dug")
    assert fine.reshape(25, 50, 80, 50).mean((1, 3)) == pytest.approx(coarse, abs=1e-9)
    assert coarse.max() > 0.3
    few = xy[:1000]
    many = np.resize(np.c_[few, np.full(1000, 3.0)], (1_100_000, 3))  # one after the other, again
    many[-100_000:, 2] = 4
    ranges = site.cast(many, np.broadcast_to((0.0, 0.0, -1.0), many.shape))
    assert ranges == pytest.approx(many[:, 2] - np.resize(heights[:1000], 1_100_000), abs=1e-6)


def test_a_machine_is_placed_elsewhere(soil):
    site = make_site(soil)
    site.update_path(0, positions=dig()[0][:40], rotations=dig()[1][:40])
    books, change = site.ledger(0), site.change_m3()
    update = site.place(0, position=(40, 3, 2), time=5.0)
    assert update.cut_m3 == 0 and site.ledger(0)["cut_m3"] == books["cut_m3"]
    assert site.pose(0)[0].tolist() == [40, 3, 2]
    if soil is None:
        assert site.change_m3() == change
    with pytest.raises(soilvdb.StateError, match="only be placed in the air") as told:
        site.place(0, position=(40, 3, -0.2))
    assert told.value.machine == "machine 0"
    with pytest.raises(soilvdb.StateError, match="^machine 'machine 0': the position is .* within"):
        site.place(0, position=(9e8, 3, 2))
    site.update(0, position=(40, 3, -0.2), time=9.0)
    assert site.heights([(20, 1.5)])[0] == 0


def test_heights_are_those_of_the_mesh():
    site = make_site(voxel_size=0.05)
    site.update_path(0, positions=dig()[0], rotations=dig()[1])
    xy = np.random.default_rng(2).uniform((-2.2, -0.5), (-1.0, 0.5), (500, 2))  # the floor
    assert site.heights(xy) == pytest.approx(site.mesh_heights(xy), abs=0.01)
    far = np.random.default_rng(2).uniform(5, 9, (50, 2))
    assert (site.heights(far) == 0).all() and (site.mesh_heights(far) == 0).all()


def test_the_end_of_a_raster_is_no_ground(tmp_path):
    (tmp_path / "flat.asc").write_text(
        "ncols 13\nnrows 13\nxllcenter -6\nyllcenter -6\ncellsize 1\n" + ("0 " * 13 + "\n") * 13)
    site = soilvdb.Site(0.1, soilvdb.raster(str(tmp_path / "flat.asc")), [bucket()])
    site.update(0, position=(4, 0, -0.2))
    before = site.save()
    with pytest.raises(soilvdb.NoGroundError, match="ground without a height"):
        site.update(0, position=(9, 0, -0.2))
    assert site.save() == before
    assert np.isnan(site.heights([(20, 0)])).all()


def test_a_closed_site_says_so():
    with make_site() as site:
        site.update(0, position=(0, 0, 0))
    for use in (lambda: site.update(0, position=(0, 0, 0)), site.save, site.mesh,
                lambda: site.heights([(0, 0)]), site.clone):
        with pytest.raises(RuntimeError, match="the site is closed"):
            use()
    site.close()


def test_threads_take_turns():
    positions, rotations = dig(40)
    site, errors = make_site(), []

    def look():
        try:
            for _ in range(20):
                site.heights([(0, 0), (1, 0)])
                site.changed_patches()
        except Exception as error:  # noqa: BLE001
            errors.append(error)

    threads = [threading.Thread(target=look) for _ in range(4)]
    for thread in threads:
        thread.start()
    site.update_path(0, positions=positions, rotations=rotations)
    for thread in threads:
        thread.join()
    alone = make_site()
    alone.update_path(0, positions=positions, rotations=rotations)
    assert not errors and site.save() == alone.save()


def test_other_threads_run_meanwhile():
    positions, rotations = dig(2000)
    site, ticks, stop = make_site(LOAM, 0.05), [], threading.Event()

    def tick():
        while not stop.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    thread = threading.Thread(target=tick)
    thread.start()
    begin = time.monotonic()
    site.update_path(0, positions=positions, rotations=rotations)
    took = time.monotonic() - begin
    stop.set()
    thread.join()
    assert took > 0.05
    assert len(ticks) > 5


def _use_in_child(queue):
    try:
        make_site().update(0, position=(0, 0, 0))
        queue.put("used")
    except RuntimeError as error:
        queue.put(str(error))


def test_a_forked_process_is_told_to_spawn():
    make_site().update(0, position=(0, 0, -1))
    for method, wanted in (("fork", "forked"), ("spawn", "used")):
        context = multiprocessing.get_context(method)
        queue = context.Queue()
        child = context.Process(target=_use_in_child, args=(queue,))
        child.start()
        assert wanted in queue.get(timeout=60)
        child.join()


LONG_PATH = (
    "import numpy as np, signal, soilvdb, threading, time\n"
    "site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])\n"
    "x = np.tile(np.linspace(0, 5, 50), 200000)\n"
    "p = np.stack([x, 0 * x, -0.2 + 0 * x - np.arange(len(x)) * 1e-7], axis=1)\n")


@pytest.mark.parametrize("call", ["update_path(0, positions=p)", "heights(q)"])
def test_ctrl_c_ends_a_long_call(call):
    code = LONG_PATH + (
        "site.update_path(0, positions=p[:50])\n"
        "q = np.random.default_rng(1).uniform(0, 5, (20000000, 2))\n"
        f"try:\n    print('ready', flush=True)\n    site.{call}\n"
        "except KeyboardInterrupt:\n    print('stopped', site.ledger()['cut_m3'] > 0)\n")
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True,
                             env=dict(os.environ))
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.1)
    child.send_signal(signal.SIGINT)
    begin = time.monotonic()
    assert child.stdout.read() == "stopped True\n"
    assert time.monotonic() - begin < 5
    assert child.wait() == 0


def test_a_handler_of_signals_is_refused_the_site_whose_call_it_interrupts():
    code = LONG_PATH + (
        "def handle(*_):\n    site.save()\n"
        "signal.signal(signal.SIGALRM, handle)\n"
        "signal.setitimer(signal.ITIMER_REAL, 0.2)\n"
        "try:\n    site.update_path(0, positions=p)\n"
        "except RuntimeError as error:\n    print(error)\n"
        "print(site.ledger()['cut_m3'] > 0)\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          check=True)
    assert done.stdout == "this thread is already in a call of the site\nTrue\n"


def test_a_program_ends_beside_threads_that_go_on():
    code = LONG_PATH + (
        "def go_on(call):\n    while True:\n        call()\n"
        "def start(call):\n    threading.Thread(target=go_on, args=(call,), daemon=True).start()\n"
        "other = site.clone()\n"
        "start(lambda: other.update_path(0, positions=p))\n"
        # It is in that long call once the program has used so much of the processor.
        "while time.process_time() < 1.5 + begun:\n    time.sleep(0.01)\n"
        "start(lambda: site.update(0, position=(0, 0, 0)))\n"
        "start(lambda: site.heights(p[:9, :2]))\n"
        "time.sleep(0.1)\n").replace("other = site", "begun = time.process_time()\nother = site")
    # One waits for a site that another will never give back.
    code += "threading.Thread(target=go_on, args=(other.change_m3,), daemon=True).start()\n"
    for _ in range(5 if LONG else 2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True,
                              timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, "")
    code = "import atexit\natexit.register(lambda: print(late()))\n" + code + (
        "def late():\n"
        "    try:\n        other.change_m3()\n"
        "    except RuntimeError as error:\n        return error\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "the site is in a call of a thread that ended with the program\n"


def test_run_says_what_the_program_says(tmp_path):
    (tmp_path / "s.yaml").write_text("soilvdb: 1\nvoxel_siz: 0.1\n")
    with pytest.raises(ValueError, match=r"s.yaml:2: unknown key 'voxel_siz' in scenario"):
        soilvdb.run(tmp_path / "s.yaml", out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_recorded_site_goes_on_where_it_was(soil, tmp_path):
    positions, rotations = dig()
    times = 0.1 * np.arange(len(positions))

    def feed(site, begin, end):
        site.update_path(0, positions=positions[begin:end], rotations=rotations[begin:end],
                         times=times[begin:end])

    never_stopped = make_site(soil)
    feed(never_stopped, 0, 60)
    with make_site(soil) as site:
        assert site.record(tmp_path / "site", snapshot_every=2, incremental=True) == (0, 0.0)
        feed(site, 0, 40)
        site.flush()
        assert site.acknowledged == (40, pytest.approx(3.9))
        with pytest.raises(ValueError, match="recorded"):
            site.restore(never_stopped.save())
        with pytest.raises(ValueError, match="recorded already"):
            site.record(tmp_path / "other")
        with pytest.raises(ValueError, match="at work in this folder"):
            make_site(soil).record(tmp_path / "site")
    assert (tmp_path / "site" / "soil_2.vdb").exists()
    with pytest.raises(ValueError, match="another site: voxel_size_m differs"):
        make_site(soil, voxel_size=0.2).record(tmp_path / "site")
    site = make_site(soil)
    assert site.record(str(tmp_path / "site"))[0] == 40
    feed(site, 40, 60)
    assert site.save() == never_stopped.save()
    site.stop_recording()
    site.restore(site.save())


def test_a_forked_process_that_ends_as_any_other_does_end():
    code = ("import os, soilvdb, sys\n"
            "if os.fork() == 0:\n    print('out')\n    sys.exit(5)\n"
            "print(os.waitstatus_to_exitcode(os.wait()[1]))\n")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60,
                          check=True)
    assert done.stdout == "out\n5\n"


def test_a_forked_process_leaves_a_recording_alone(tmp_path):
    site = make_site()
    site.record(tmp_path / "site", sync=0)
    site.update(0, position=(0, 0, -0.2), time=0)
    child = os.fork()
    if child == 0:
        del site
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
    site.update(0, position=(1, 0, -0.2), time=1)
    assert site.acknowledged == (2, 1.0)


def test_ctrl_c_ends_going_on_with_a_recording(tmp_path):
    code = (
        "import numpy as np, soilvdb, sys\n"
        "def make():\n"
        "    return soilvdb.Site(0.03, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])\n"
        "x = np.tile(np.linspace(0, 5, 50), 2000)\n"
        "p = np.stack([x, 0 * x, -0.2 + 0 * x - np.arange(len(x)) * 1e-6], axis=1)\n"
        "with make() as site:\n"
        "    site.record('rec')\n"
        "    site.update_path(0, positions=p)\n"
        "print('ready', flush=True)\n"
        "site = make()\n"
        "try:\n    site.record('rec')\n"
        "except KeyboardInterrupt:\n    print('stopped', site.ledger()['cut_m3'])\n")
    child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True,
                             env=dict(os.environ), cwd=tmp_path)
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.3)
    child.send_signal(signal.SIGINT)
    assert child.stdout.read() == "stopped 0.0\n", "as it was before"
    assert child.wait() == 0


def test_a_site_with_little_memory_gives_the_same_bits(soil, tmp_path):
    positions, rotations = dig()
    free, limited = make_site(soil, 0.05), make_site(soil, 0.05)
    limited.limit_memory(0.3, tmp_path)
    for site in (free, limited):
        site.update_path(0, positions=positions, rotations=rotations)
    assert free.save() == limited.save()
    with pytest.raises(RuntimeError, match="limited"):
        limited.clone()
    for bad in (0, -1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="more than 0"):
            limited.limit_memory(bad, tmp_path)
    with pytest.raises(RuntimeError):
        make_site().limit_memory(1, tmp_path / "none")


def test_a_recording_keeps_the_snapshots_it_is_told_to(tmp_path):
    positions, rotations = dig()
    sizes = {}
    for incremental in (False, True):
        for keep in (None, 2):
            folder = tmp_path / f"{incremental} {keep}"
            with make_site() as site:
                site.record(folder, snapshot_every=0.5, incremental=incremental, keep=keep)
                for i, (position, rotation) in enumerate(zip(positions, rotations)):
                    site.update(0, position=position, rotation=rotation, time=0.1 * i)
                    site.flush()  # else a snapshot that comes due may have to wait for the last
            sizes[incremental, keep] = [f.stat().st_size for f in folder.glob("*.vdb")]
    assert len(sizes[False, None]) == len(sizes[True, None]) == 11
    assert len(sizes[False, 2]) == 2
    assert sum(sizes[True, None]) < sum(sizes[False, None])


def test_many_sites_turn_each_its_own_way_at_one_time():
    start = make_site(LOAM)
    start.update(0, position=(0, 0, 0.5), time=1)
    sites = [start.clone() for _ in range(3)]
    places = np.array([(0.5, 0, -0.1), (0.5, 0, -0.2), (0.6, 0, -0.2)])
    turns = np.array([(0, np.sin(a), 0, np.cos(a)) for a in (0, 0.1, -0.2)])
    soilvdb.update_many(sites, 0, positions=places, rotations=turns, time=2)
    for site, place, turn in zip(sites, places, turns):
        alone = start.clone()
        alone.update(0, position=place, rotation=turn, time=2)
        assert alone.save() == site.save()


def test_books_of_a_path_are_those_of_its_updates(soil):
    positions, rotations = dig()
    site, single = make_site(soil), make_site(soil)
    path = site.update_path(0, positions=positions, rotations=rotations)
    updates = [single.update(0, position=p, rotation=q) for p, q in zip(positions, rotations)]
    for name in ("cut_m3", "bucket_m3", "spilled_m3", "slid_m3"):
        assert path[name].tolist() == [getattr(update, name) for update in updates]
    books = site.ledger(0)
    assert books["cut_m3"] == pytest.approx(path["cut_m3"].sum())
    assert books["spilled_m3"] == pytest.approx(path["spilled_m3"].sum())
    assert books["bucket_m3"] == path["bucket_m3"][-1]
    assert books["cut_m3"] == pytest.approx(books["captured_m3"] + books["displaced_m3"])
    if soil is None:  # what moves is loose where it is dug again
        assert books["captured_m3"] == pytest.approx(books["bucket_m3"] + books["spilled_m3"])
