# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The force of the soil on a bucket, from Python."""

import math
import pickle

import numpy as np
import pytest

import soilvdb
from soilvdb._row_errors import covariance

DEG = math.pi / 180
G = 9.80665
LOAM = soilvdb.Soil(density=18e3 / G, cohesion=1e4, friction_angle=30 * DEG, tool_friction=20 * DEG)
PROFILE = [(0, 0), (-0.5, 0.1), (-0.85, 0.4), (-0.6, 0.9), (0, 0.9)]


def turned(pitch):
    return (0.0, math.sin(pitch / 2), 0.0, math.cos(pitch / 2))


def blade(rake=60, voxel=0.05, terrain=None, soil=None):
    """A blade 1.2 m wide, 0.3 m deep in level ground."""
    site = soilvdb.Site(voxel, terrain or soilvdb.plane(0.3), [soilvdb.Bucket(1.2, 1.0)], soil=soil)
    for x in (-0.6, -0.3, 0.0):
        site.update(0, position=(x, 0, 0), rotation=turned((rake - 90) * DEG))
    return site


def test_force_of_a_blade_is_that_of_the_formula():
    r = blade().resistance(0, soil=LOAM, crescents=False)
    to_world = np.array([[math.cos(30 * DEG), 0, -0.5], [0, 1, 0], [0.5, 0, math.cos(30 * DEG)]])
    cut = r.parts["cut"]
    np.testing.assert_allclose(to_world @ cut.force, [-12356.4, 0, -2178.8], atol=5)
    np.testing.assert_allclose(cut.moment, [0, -1876.0, 0], atol=3)
    np.testing.assert_allclose(r.world.force, to_world @ r.force, atol=1e-6)
    np.testing.assert_allclose(r.world.moment, to_world @ r.moment, atol=1e-6)
    assert set(r.parts) == {"cut", "edge", "load", "heel"}
    np.testing.assert_allclose(sum(p.force for p in r.parts.values()), r.force)
    np.testing.assert_allclose(sum(p.moment for p in r.parts.values()), r.moment)
    assert r.angle == pytest.approx(34.045 * DEG, abs=0.001)
    assert r.depth_m == pytest.approx(0.3) and r.limited == ""
    assert "soilvdb.Resistance(force=[" in repr(r)
    more = blade().resistance(soil=LOAM)
    assert np.linalg.norm(more.parts["cut"].force) > 1.3 * np.linalg.norm(cut.force)
    assert blade(100).resistance(soil=LOAM).limited == "steep blade"


def test_jacobian_is_that_of_differences():
    site = blade()
    names = ("density", "cohesion", "friction_angle", "tool_friction", "adhesion")
    at = dict(zip(names, (1800.0, 9e3, 0.5, 0.3, 800.0)))
    jacobian = site.resistance(soil=soilvdb.Soil(**at)).jacobian
    for k, name in enumerate(names):
        d = 1e-5 * at[name]
        more, less = (site.resistance(soil=soilvdb.Soil(**{**at, name: at[name] + s * d})).force
                      for s in (1, -1))
        np.testing.assert_allclose(jacobian[:, k], (more - less) / (2 * d),
                                   rtol=1e-4, atol=1e-5 * np.abs(jacobian[:, k]).max())


def test_soil_says_what_a_force_needs():
    rigid = blade()
    with pytest.raises(ValueError, match="soil is rigid here; say soil="):
        rigid.resistance(0)
    with pytest.raises(ValueError, match="needs the soil's angle of friction or of repose"):
        soilvdb.Soil(density=1800)
    with pytest.raises(ValueError, match="needs an angle of repose"):
        soilvdb.Site(0.1, soilvdb.plane(), [soilvdb.Bucket(1, 1)], soil=LOAM)
    with pytest.raises(ValueError, match="adhesion must be 0 or more"):
        soilvdb.Soil(0.6, adhesion=-1)
    with pytest.raises(ValueError, match="tool friction is 20; it must be in radians"):
        soilvdb.Soil(0.6, tool_friction=20)
    with pytest.raises(ValueError, match="edge is -1 m"):
        soilvdb.Bucket(1, 1, edge=-1)
    assert LOAM.repose_angle is None and LOAM.tool_friction == 20 * DEG
    again = pickle.loads(pickle.dumps(soilvdb.Soil(0.6, tool_friction=0.2, adhesion=30)))
    assert (again.repose_angle, again.tool_friction, again.adhesion) == (0.6, 0.2, 30)
    with pytest.raises(ValueError, match="plate is there without a profile"):
        soilvdb.Bucket(1, 1, plate=0.03)
    bucket = pickle.loads(pickle.dumps(soilvdb.Bucket(1.2, 0.9, PROFILE, edge=0.02, plate=0.03)))
    assert (bucket.edge, bucket.plate) == (0.02, 0.03)
    with pytest.raises(ValueError, match="meets no soil before its first state"):
        soilvdb.Site(0.1, soilvdb.plane(), [soilvdb.Bucket(1, 1)]).resistance(soil=LOAM)


def test_site_with_soil_needs_no_other():
    soil = soilvdb.Soil(0.6, 0.2, 1800, 5e3, 0.55)
    site = blade(soil=soil)
    np.testing.assert_array_equal(site.resistance().force, site.resistance(soil=soil).force)
    assert site.resistance().parts["load"].force[2] < 0


def test_nothing_presses_in_the_air_or_on_the_way_back():
    site = soilvdb.Site(0.1, soilvdb.plane(0), [soilvdb.Bucket(1.2, 0.9, PROFILE)])
    for z in (0.5, 0.3, 0.2, 0.09, 0.04, 0.01):
        site.update(0, position=(0, 0, z))
        np.testing.assert_array_equal(site.resistance(soil=LOAM).force, 0)
    for voxel in (0.1, 0.05):
        site = soilvdb.Site(voxel, soilvdb.plane(0), [soilvdb.Bucket(1.2, 0.9, PROFILE)])
        for k in range(41):
            site.update(0, position=(0.05 * k, 0, 0.1 - min(0.3, 0.02 * k)), rotation=turned(0.1))
        digging = site.resistance(soil=LOAM)
        assert digging.parts["cut"].force[0] < -2000
        rng = np.random.default_rng(1)
        for _ in range(20):  # it stands, as sensors see it
            site.update(0, position=np.array([2.0, 0, -0.2]) + rng.normal(0, 0.0005, 3),
                        rotation=turned(0.1))
            r = site.resistance(soil=LOAM)
            np.testing.assert_array_equal(r.parts["heel"].force, digging.parts["heel"].force)
            assert abs(r.force[0] / digging.force[0] - 1) < 0.1
        site.update(0, position=(1.98, 0, -0.2), rotation=turned(0.1))
        r = site.resistance(soil=LOAM)
        np.testing.assert_array_equal(r.force, r.parts["load"].force)


def test_what_can_not_be_told_is_said():
    heights = np.full((61, 61), 0.3)
    heights[:, 34:] = np.nan
    wall = blade(90, 0.1, soilvdb.raster(heights, origin=(-3, -3), cell=0.1))
    assert wall.resistance(soil=LOAM).limited != ""
    firm = soilvdb.Soil(density=1800, friction_angle=1.5, tool_friction=1.5)
    assert "no failure plane" in blade(60).resistance(soil=firm).limited
    rolled = soilvdb.Site(0.1, soilvdb.plane(0.3), [soilvdb.Bucket(1.2, 1.0)])
    for x in (-0.6, -0.3, 0.0):
        rolled.update(0, position=(x, 0, 0), rotation=(math.sin(0.6), 0, 0, math.cos(0.6)))
    assert rolled.resistance(soil=LOAM).limited == "rolled over"


def test_many_sites_are_each_as_alone():
    sites = [blade(rake) for rake in (40, 60, 80)]
    sites.append(soilvdb.Site(0.1, soilvdb.plane(), [soilvdb.Bucket(1, 1)]))
    forces, moments = soilvdb.resistances(sites, soil=LOAM, threads=2)
    for k in range(3):
        alone = sites[k].resistance(soil=LOAM)
        np.testing.assert_array_equal(forces[k], alone.force)
        np.testing.assert_array_equal(moments[k], alone.moment)
    assert np.isnan(forces[3]).all() and np.isnan(moments[3]).all()


def test_each_site_may_have_a_soil_of_its_own():
    sites = [blade(rake) for rake in (40, 60)]
    soft = soilvdb.Soil(density=1600, cohesion=2e3, friction_angle=0.5)
    forces, _ = soilvdb.resistances(sites, soil=[LOAM, soft])
    np.testing.assert_array_equal(forces[0], sites[0].resistance(soil=LOAM).force)
    np.testing.assert_array_equal(forces[1], sites[1].resistance(soil=soft).force)
    with pytest.raises(ValueError, match="there are 1 soils for 2 sites"):
        soilvdb.resistances(sites, soil=[LOAM])
    with pytest.raises(TypeError, match="each of soil must be soilvdb.Soil, not int"):
        soilvdb.resistances(sites, soil=[LOAM, 3])
    with pytest.raises(TypeError, match="soil must be a list of soilvdb.Soil, not int"):
        soilvdb.resistances(sites, soil=3)
    assert sites[0].soil is None
    assert blade(soil=soilvdb.Soil(0.6, 0.2, cohesion=5e3)).soil.cohesion == 5e3


def test_geometry_resists_alike_after_pickle():
    """To the bit: a blade, a bucket with a load, edges and a heel, one that rolled over."""
    edged = soilvdb.Site(0.05, soilvdb.plane(0, (0.1, 0.05)),
                         [soilvdb.Bucket(1.2, 0.9, PROFILE, edge=0.02, plate=0.03)])
    for k in range(30):
        edged.update(0, position=(0.05 * k, 0, 0.1 - min(0.4, 0.03 * k)), rotation=turned(0.1))
    heel = edged.cut_geometry()
    edged.update(0, position=(1.5, 0, -0.33), rotation=turned(-0.1))
    rolled = soilvdb.Site(0.1, soilvdb.plane(0.3), [soilvdb.Bucket(1.2, 1.0)])
    for x in (-0.3, 0.0):
        rolled.update(0, position=(x, 0, 0), rotation=(math.sin(0.6), 0, 0, math.cos(0.6)))
    found = []
    for geometry in (blade().cut_geometry(), blade(100).cut_geometry(), heel, edged.cut_geometry(),
                     rolled.cut_geometry()):
        again = pickle.loads(pickle.dumps(geometry))
        for crescents in (True, False):
            one, other = (g.resistance(LOAM, crescents=crescents) for g in (geometry, again))
            for part in ("cut", "edge", "load", "heel"):
                np.testing.assert_array_equal(one.parts[part].force, other.parts[part].force)
                np.testing.assert_array_equal(one.parts[part].moment, other.parts[part].moment)
            np.testing.assert_array_equal(one.jacobian, other.jacobian)
            np.testing.assert_array_equal(one.world.force, other.world.force)
            assert (one.angle, one.depth_m, one.limited) == (other.angle, other.depth_m,
                                                             other.limited)
        found.append(one.limited)
    assert found[1] == "steep blade" and "heel" in found[3] and found[4] == "rolled over"


def test_bytes_of_no_geometry_are_refused():
    geometry = blade().cut_geometry()
    state = geometry.__getstate__()
    rng = np.random.default_rng(1)
    for size in (0, 1, 9, 100, len(state) - 1):
        with pytest.raises(ValueError):
            soilvdb.CutGeometry.__new__(soilvdb.CutGeometry).__setstate__(state[:size])
    with pytest.raises(ValueError, match="not the geometry of a cut"):
        soilvdb.CutGeometry.__new__(soilvdb.CutGeometry).__setstate__(state + b"0")
    for _ in range(300):  # damaged ones are refused, or resist somehow
        damaged = bytearray(state)
        for at in rng.integers(0, len(state), 3):
            damaged[at] = rng.integers(256)
        made = soilvdb.CutGeometry.__new__(soilvdb.CutGeometry)
        try:
            made.__setstate__(bytes(damaged))
        except ValueError:
            continue
        assert made.resistance(LOAM).force.shape == (3,)


def test_force_is_the_same_on_a_clone_and_after_a_restore():
    site = blade()
    before, state = site.resistance(soil=LOAM).force, site.save()
    np.testing.assert_array_equal(site.clone().resistance(soil=LOAM).force, before)
    site.update(0, position=(-0.2, 0, 0.1), rotation=turned(-30 * DEG))
    np.testing.assert_array_equal(site.resistance(soil=LOAM).parts["cut"].force, 0)
    site.restore(state)
    np.testing.assert_array_equal(site.resistance(soil=LOAM).force, before)


URDF = """<robot name="arm"><link name="root"/><link name="slide"/><link name="boom"/>
<link name="bucket"/>
<joint name="drive" type="prismatic"><parent link="root"/><child link="slide"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" velocity="1" effort="1"/></joint>
<joint name="swing" type="revolute"><parent link="slide"/><child link="boom"/><axis xyz="0 0 1"/>
<origin xyz="0 0 1.5"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
<joint name="curl" type="revolute"><parent link="boom"/><child link="bucket"/><axis xyz="0 1 0"/>
<origin xyz="2 0 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint></robot>"""


def test_torques_are_the_forces_work_over_the_joints_ways(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(URDF)
    lip = np.eye(4)
    lip[2, 3] = -1.5
    machine = soilvdb.Machine(soilvdb.Bucket(1.2, 1.0), urdf=file, lip=lip)
    site = soilvdb.Site(0.05, soilvdb.plane(0.3), [machine])
    for drive in (-2.0, -1.8, -1.6):
        joints = np.array([drive, 0.2, -0.3])
        site.update(0, joints=joints)
    r = site.resistance(soil=LOAM)
    torques = site.torques(soil=LOAM)
    assert torques.shape == (3,)
    for k in range(3):
        ends = []
        for d in (1e-6, -1e-6):
            step = joints.copy()
            step[k] += d
            ends.append(site.pose(0, joints=step))
        (p1, q1), (p0, q0) = ends
        way = (p1 - p0) / 2e-6
        q0 = q0 * np.array([-1, -1, -1, 1])
        turn = 2 * (q1[3] * q0[:3] + q0[3] * q1[:3] + np.cross(q1[:3], q0[:3])) / 2e-6
        assert torques[k] == pytest.approx(r.world.force @ way + r.world.moment @ turn, rel=1e-5,
                                           abs=1e-3)
    with pytest.raises(ValueError, match="no state that was given by joints"):
        blade().torques(soil=LOAM)


def dig_rows(count, seed):
    """Geometries over a dig whose depth changes."""
    rng = np.random.default_rng(seed)
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)])
    rows = []
    for step in range(count):
        depth = -0.35 + 0.25 * math.cos(step / 9) + rng.uniform(-0.01, 0.01)
        pitch = 0.35 + 0.25 * math.sin(step / 13)
        site.update(0, position=(0.04 * step, 0, depth), rotation=turned(pitch))
        rows.append(site.cut_geometry())
    return rows[5:]


def test_identify_finds_the_soil_and_how_well():
    rows = dig_rows(105, 1)
    truth = soilvdb.Soil(density=1750, cohesion=7e3, friction_angle=0.52, tool_friction=0.35)
    exact = np.array([row.resistance(truth).force for row in rows])
    found = soilvdb.identify(rows, exact, soil=soilvdb.Soil(density=1750, friction_angle=0.7,
                                                            tool_friction=0.35))
    assert found.cohesion == pytest.approx(7e3, rel=1e-3)
    assert found.friction_angle == pytest.approx(0.52, rel=1e-3)
    assert found.told_apart and found.soil.density == 1750
    rng = np.random.default_rng(2)
    inside = np.zeros(2)
    draws = 60
    for _ in range(draws):
        noisy = exact * (1 + 0.05 * rng.standard_normal(exact.shape))
        got = soilvdb.identify(rows, noisy, soil=soilvdb.Soil(density=1750, friction_angle=0.6,
                                                              tool_friction=0.35))
        assert 0.01 < got.noise < 0.06
        inside += [abs(got.cohesion - 7e3) < 2 * got.cohesion_sigma,
                   abs(got.friction_angle - 0.52) < 2 * got.friction_angle_sigma]
    assert (inside > 0.85 * draws).all()
    # Errors that go on from row to row tell less.
    last = [soilvdb.identify(rows, exact * (1 + 0.05 * lasting(rng, len(rows), 0.8)),
                             soil=soilvdb.Soil(density=1750, friction_angle=0.6, tool_friction=0.35))
            for _ in range(20)]
    assert np.median([each.cohesion_sigma for each in last]) > 1.5 * got.cohesion_sigma
    assert sum(abs(each.cohesion - 7e3) < 2.5 * each.cohesion_sigma for each in last) > 15


def lasting(rng, count, rho):
    """(count, 3), variance 1: an autoregressive process from row to row; rho 0: independent."""
    errors = rng.standard_normal((count, 3))
    for row in range(1, count):
        errors[row] = rho * errors[row - 1] + math.sqrt(1 - rho**2) * errors[row]
    return errors


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_truth_is_inside_two_sigma_of_errors_that_go_on(rho):
    """Of the fit's linear part with a dig's own derivatives; `tools/bench force` has the whole."""
    rows = dig_rows(205, 1)
    felt = [row.resistance(soilvdb.Soil(density=1750, cohesion=7e3, friction_angle=0.52))
            for row in rows]
    sizes = np.array([np.linalg.norm(r.force) for r in felt])
    by = np.array([np.stack([1e4 * r.jacobian[:, 1], r.jacobian[:, 2] + 2 / 3 * r.jacobian[:, 3]],
                            axis=1) for r in felt]) / sizes[:, None, None]
    inverse = np.linalg.inv(np.einsum("nip,niq->pq", by, by))
    rng, inside, draws = np.random.default_rng(4), np.zeros(2), 150
    for _ in range(draws):
        error = 0.03 * lasting(rng, len(rows), rho)
        off = inverse @ np.einsum("nip,ni->p", by, error)
        sigma = np.sqrt(np.diag(covariance(np.arange(200.0), by, error - by @ off)))
        inside += np.abs(off) < 2 * sigma
    of_chance = 3 * np.sqrt(0.954 * 0.046 / draws)
    assert (np.abs(inside / draws - 0.954) < of_chance).all(), inside / draws


def test_sigmas_know_gaps_and_rows_that_are_exact():
    rows = dig_rows(105, 1)
    truth = soilvdb.Soil(density=1750, cohesion=7e3, friction_angle=0.52, tool_friction=0.35)
    exact = np.array([row.resistance(truth).force for row in rows])
    found = soilvdb.identify(rows, exact, soil=truth)
    assert found.cohesion_sigma < 1e-3 and found.friction_angle_sigma < 1e-7
    assert not covariance(np.arange(9.0), np.ones((9, 3, 2)), np.zeros((9, 3))).any()
    rng = np.random.default_rng(3)
    by = rng.standard_normal((200, 3, 2)) + 1

    def sigma(numbers, error):
        return np.sqrt(np.diag(covariance(numbers.astype(float), by, error)))

    apart = np.flatnonzero(np.arange(1000) % 50 < 10)  # ten rows of each fifty
    more, less = [], []
    for _ in range(20):
        error = lasting(rng, 1000, 0.8)
        more.append(sigma(np.arange(200), error[:200]) / sigma(np.arange(200), error[::5]))
        less.append(sigma(apart, error[apart]) / sigma(np.arange(200), error[apart]))
    assert (np.mean(more, axis=0) > 1.2).all() and (np.mean(less, axis=0) < 0.99).all()


@pytest.mark.parametrize("share", [0.5, 0.62, 0.9, 1.0])
def test_sigmas_know_that_the_tool_friction_is_a_guess(share):
    rows = dig_rows(105, 1)
    truth = soilvdb.Soil(density=1750, cohesion=7e3, friction_angle=0.52, tool_friction=share * 0.52)
    exact = np.array([row.resistance(truth).force for row in rows])
    found = soilvdb.identify(rows, exact, soil=soilvdb.Soil(density=1750, friction_angle=0.6))
    assert abs(found.cohesion - 7e3) < 3 * found.cohesion_sigma
    assert abs(found.friction_angle - 0.52) < 3 * found.friction_angle_sigma
    assert found.friction_angle_sigma < 0.3


@pytest.mark.parametrize("seed", range(8))
def test_rows_of_one_pose_have_no_sigma(seed):
    """Cohesion and friction then change one number."""
    site = blade()
    force = site.resistance(soil=LOAM).force
    noise = 1 + 0.05 * np.random.default_rng(seed).standard_normal((100, 3))
    found = soilvdb.identify([site.cut_geometry()] * 100, force * noise, soil=LOAM)
    assert not found.told_apart and "other depths" in found.why
    assert math.isinf(found.cohesion_sigma) and math.isinf(found.friction_angle_sigma)
    assert abs(found.correlation) == 1


def test_identify_takes_the_scenario_of_a_dig(tmp_path):
    (tmp_path / "dig.csv").write_text("time,x,y,z,qx,qy,qz,qw\n" + "".join(
        f"{step / 10},{0.04 * step - 3},{side},{-0.3 + 0.2 * math.cos(step / 9)},0,"
        f"{math.sin(0.25)},0,{math.cos(0.25)}\n" for side in (0,) for step in range(60)))
    (tmp_path / "other.csv").write_text("time,x,y,z,qx,qy,qz,qw\n" + "".join(
        f"{step / 10 + 0.05},{3 - 0.04 * step},0.5,-0.4,0,0,1,0\n" for step in range(60)))
    (tmp_path / "dig.yaml").write_text("""soilvdb: 1
name: dig
voxel_size: 0.1
terrain: {plane: {z: 0}}
machines:
  - {name: digger, bucket: {width: 1.2, height: 0.9}, motion: dig.csv}
  - {name: other, bucket: {width: 1.2, height: 0.9}, motion: other.csv}
  - {name: idle, bucket: {width: 1.2, height: 0.9}}
""")
    site, rows = soilvdb.Site.open(tmp_path / "dig.yaml"), []
    motions = soilvdb.motions(tmp_path / "dig.yaml")
    for step in range(60):  # by turns
        for name in ("digger", "other"):
            of = motions[name]
            site.update(name, position=of["positions"][step], rotation=of["rotations"][step],
                        time=of["times"][step])
            if name == "digger":
                rows.append(site.cut_geometry(name))
    truth = soilvdb.Soil(density=1750, cohesion=7e3, friction_angle=0.52, tool_friction=0.35)
    forces = np.array([row.resistance(truth).force for row in rows])
    guess = soilvdb.Soil(density=1750, friction_angle=0.6, tool_friction=0.35)
    for machine in ("digger", 0):
        found = soilvdb.identify(tmp_path / "dig.yaml", forces, soil=guess, machine=machine)
        alone = soilvdb.identify(rows, forces, soil=guess)
        assert (found.cohesion, found.friction_angle, found.noise, found.cohesion_sigma) == (
            alone.cohesion, alone.friction_angle, alone.noise, alone.cohesion_sigma)
    assert found.cohesion == pytest.approx(7e3, rel=1e-3)
    with pytest.raises(ValueError, match="no motion of machine 'idle'; it has those of 'digger', 'oth"):
        soilvdb.identify(tmp_path / "dig.yaml", forces, soil=guess, machine="idle")
    with pytest.raises(TypeError, match="rows is a Site, which knows its last state only"):
        soilvdb.identify(site, forces, soil=guess)


def test_identify_says_when_rows_do_not_tell():
    site = blade()
    rows = [site.cut_geometry()] * 50
    forces = np.array([row.resistance(LOAM).force for row in rows])
    forces *= 1 + 0.02 * np.random.default_rng(1).standard_normal(forces.shape)
    found = soilvdb.identify(rows, forces, soil=soilvdb.Soil(density=18e3 / G, friction_angle=0.4,
                                                             tool_friction=20 * DEG))
    assert not found.told_apart and "rows of other depths" in found.why
    assert found.cohesion_sigma == math.inf
    with pytest.raises(ValueError, match="it must be \\(50, 3\\)"):
        soilvdb.identify(rows, forces[:20], soil=LOAM)
    with pytest.raises(ValueError, match="row 3 is not finite"):
        forces[3, 1] = np.nan
        soilvdb.identify(rows, forces, soil=LOAM)
    for wrong, why in (((row for row in [1]), "row 0 is int"), ([site], "row 0 is Site")):
        with pytest.raises(TypeError, match=why):
            soilvdb.identify(wrong, forces, soil=LOAM)
    with pytest.raises(TypeError, match="forces must be an array"):
        soilvdb.identify(rows, ["a"] * 50, soil=LOAM)
    with pytest.raises(TypeError, match="soil must be soilvdb.Soil, not NoneType"):
        soilvdb.identify(rows, forces, soil=None)
    zero = soilvdb.identify(dig_rows(40, 2), np.zeros((35, 3)), soil=LOAM)
    assert not zero.told_apart and "check signs" in zero.why
    # A load that is lifted tells nothing of the soil.
    lifted, loads = soilvdb.Site(0.1, soilvdb.plane(), [soilvdb.Bucket(1.2, 0.9, PROFILE)]), []
    for k in range(20):
        lifted.update(0, position=(0.05 * k, 0, -0.2), rotation=turned(0.3))
    for k in range(10):
        lifted.update(0, position=(1, 0, 0.5 + 0.05 * k), rotation=turned(-0.3))
        loads.append(lifted.cut_geometry())
    with pytest.raises(ValueError, match="fewer than 4 rows have soil"):
        soilvdb.identify(loads, [load.resistance(LOAM).force for load in loads], soil=LOAM)
    air = soilvdb.Site(0.1, soilvdb.plane(), [soilvdb.Bucket(1, 1)])
    air.update(0, position=(0, 0, 3))
    with pytest.raises(ValueError, match="fewer than 4 rows have soil"):
        soilvdb.identify([air.cut_geometry()] * 9, np.zeros((9, 3)), soil=LOAM)


def test_updates_of_a_run_have_forces_and_keep_them(tmp_path):
    scenario = tmp_path / "drag.yaml"
    scenario.write_text(f"""soilvdb: 1
name: drag
voxel_size: 0.05
terrain: {{plane: {{z: 0.0}}}}
soil: {{repose_angle: 0.6, swell: 0.2, density: 1800, cohesion: 4000, tool_friction: 0.3}}
machines:
  - name: digger
    bucket: {{width: 1.2, height: 0.9, edge: 0.01, profile: {[list(p) for p in PROFILE]}}}
    motion: drag.csv
output: {{force: true}}
""")
    rows = ["time,x,y,z,qx,qy,qz,qw"]
    q = turned(0.3)
    for k in range(60):
        z = 0.4 - min(0.7, 0.1 * k)
        rows.append(f"{k / 10},{-2 + 0.05 * k},0,{z},{q[0]},{q[1]},{q[2]},{q[3]}")
    (tmp_path / "drag.csv").write_text("\n".join(rows) + "\n")
    soilvdb.run(scenario, out=tmp_path / "out")
    lines = (tmp_path / "out/updates.csv").read_text().splitlines()
    assert lines[0].endswith("slid_m3,force_x_n,force_y_n,force_z_n,moment_y_nm")
    last = [float(x) for x in lines[-1].split(",")[-4:]]
    assert last[0] < -1000 and abs(last[1]) < 1
    site = soilvdb.Site.open(scenario)
    for line in rows[1:]:
        v = [float(x) for x in line.split(",")]
        site.update(0, position=v[1:4], rotation=v[4:], time=v[0])
    r = site.resistance()
    np.testing.assert_allclose(last, [*r.force, r.moment[1]], rtol=1e-4, atol=0.5)
    again = soilvdb.run(scenario, out=tmp_path / "again")
    assert again["machines"][0]["name"] == "digger"
    text = scenario.read_text()
    scenario.write_text("\n".join(line for line in text.splitlines() if not line.startswith("soil")
                                  or line == "soilvdb: 1"))
    with pytest.raises(ValueError, match="force needs 'soil'"):
        soilvdb.run(scenario, out=tmp_path / "rigid")
