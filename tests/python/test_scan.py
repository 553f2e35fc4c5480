# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Laws of scans, over random digs: which bits they give, which volumes they book, what they refuse."""

import itertools
import math
import pickle
import warnings

import numpy as np
import pytest

import soilvdb

PROFILE = [(0, 0), (-0.45, -0.1), (-0.85, 0.15), (-0.95, 0.55), (-0.7, 0.9), (0, 0.9)]
LOAM = soilvdb.Soil(repose_angle=0.61, swell=0.25)
VOXEL = 0.1
SAMPLE_M3 = VOXEL**3 / 64
SHAPE, INTRINSICS = (96, 128), (80.0, 80.0, 63.5, 47.5)
AROUND = [(-3.5, -3.5), (3.5, -3.5), (3.5, 3.5), (-3.5, 3.5)]


def product(p, q):
    (a, b, c, d), (x, y, z, w) = p, q
    return (d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z)


def looking(down, ahead=0.0):
    """Rotation of a camera that looks along `ahead` (angle about z) and down by an angle, rad."""
    turn = (0, 0, math.sin(ahead / 2), math.cos(ahead / 2))
    lean = (0, math.sin(down / 2), 0, math.cos(down / 2))
    return product(product(turn, lean), (-0.5, 0.5, -0.5, 0.5))


def camera(position=(-4.0, 0.0, 3.5), rotation=None, name="camera", **sigmas):
    given = {"range_sigma": 0.001, "range_squared_sigma": 0.001, **sigmas}
    return soilvdb.Sensor(name=name, position=position, rotation=rotation or looking(0.75), **given)


def dig(seed, lip=0.0, soil=None, buckets=1):
    """A trench on rough ground; the machine reports its lip `lip` m too high."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-6, 6, 61), np.linspace(-6, 6, 61))
    hills = sum(rng.normal(0, 0.02) * np.sin(k * x + m * y + rng.uniform(0, 6))
                for k in (0.5, 1, 2) for m in (-1.5, 0.3, 1.2))
    terrain = soilvdb.raster(hills.astype(np.float32), origin=(-6, -6), cell=0.2)
    site = soilvdb.Site(VOXEL, terrain, [soilvdb.Bucket(1.2, 0.9, PROFILE)] * buckets, soil=soil)
    depth, yaw = rng.uniform(0.3, 0.5), rng.uniform(-0.4, 0.4)
    s = np.linspace(-1.5, 1.5, 31)
    way = np.array([math.cos(yaw), math.sin(yaw)])
    down = 0.2 - (0.2 + depth) * np.minimum(1, 2 * (1.5 - np.abs(s)))
    path = np.column_stack([s[:, None] * way, lip + down])
    site.update_path(0, positions=path, rotations=np.tile(
        (0, 0, math.sin(yaw / 2), math.cos(yaw / 2)), (31, 1)))
    site.update(0, position=(*(1.8 * way), 1.5))
    site.place(0, position=(-5, -5, 3))
    return site


def frames_of(site, sensor, count, seed=0):
    return [soilvdb.depth_image(site, sensor, SHAPE, INTRINSICS, seed=seed + k) for k in range(count)]


def points_of(depth):
    """Points (N, 3) in the sensor's frame, of an image."""
    fx, fy, cx, cy = INTRINSICS
    u, v = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    return np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth], axis=-1).reshape(-1, 3)


def applied(site, scans):
    for sensor, points in scans:
        site.scan(sensor, points)
    return site.apply_scans()


SCENES = [(1, None), (2, None), (3, LOAM)]


class Scene:
    """A site as it is believed to be, as it is, and scans (sensor, points) of how it is."""

    def __init__(self, seed, soil):
        self.seed, self.soil = seed, soil
        self.true = dig(seed, 0.0, soil)
        sensors = camera(), camera((3.5, -3.0, 3.0), looking(0.8, 2.4), "other")
        self.scans = [(sensor, points_of(depth)) for sensor in sensors
                      for depth in frames_of(self.true, sensor, 3, 10 * seed)]

    def believed(self):
        return dig(self.seed, 0.02, self.soil)


@pytest.fixture(scope="module", params=SCENES, ids=["rigid 1", "rigid 2", "moving 3"])
def scene(request):
    return Scene(*request.param)


def test_the_order_of_scans_and_their_split_do_not_show(scene):
    scans = scene.scans
    rng = np.random.default_rng(4)
    sites = [scene.believed() for _ in range(4)]
    surveys = [applied(sites[0], scans),
               applied(sites[1], [scans[k] for k in rng.permutation(len(scans))]),
               applied(sites[2], [(sensor, rng.permutation(points)) for sensor, points in scans])]
    parts = [(sensor, part) for sensor, points in scans for part in np.array_split(points, 5)]
    surveys.append(applied(sites[3], [parts[k] for k in rng.permutation(len(parts))]))
    assert surveys[0].removed_m3 + surveys[0].added_m3 > 0
    for site, survey in zip(sites[1:], surveys[1:]):
        assert site.save() == sites[0].save()
        assert (survey.removed_m3, survey.added_m3) == (surveys[0].removed_m3, surveys[0].added_m3)
        assert survey.rays == surveys[0].rays


@pytest.mark.parametrize(("seed", "soil"), SCENES)
def test_a_scan_of_own_ground_without_noise_changes_nothing(seed, soil):
    site = dig(seed, 0.0, soil)
    was = site.ground_hash()
    eye, lidar = camera(), soilvdb.Sensor(name="lidar", position=(-4, 0.5, 3), range_sigma=0.02)
    for _ in range(4):
        site.scan(eye, depth=soilvdb.depth_image(site, eye, SHAPE, INTRINSICS), intrinsics=INTRINSICS)
        site.scan(lidar, soilvdb.lidar_turn(site, lidar, 32, 256))
    survey = site.apply_scans()
    assert survey.removed_m3 == survey.added_m3 == 0
    assert site.ground_hash() == was
    assert survey.rays["used"] > 0.5 * SHAPE[0] * SHAPE[1]
    mean, sigma = survey.lip_error[0]
    assert abs(mean) < 0.001 and 0 < sigma < 0.02


MOVES = {"pose_shift_sigma": 0.02, "pose_turn_sigma": 0.005}


def jolted(rng, shift=0.02, turn=0.005, angle=0.0):
    """Where a camera beside the trench is told to stand, and where it stands: position, rotation."""
    told = (-4 * math.cos(angle), -4 * math.sin(angle), 3.5), looking(0.75, angle)
    half = rng.normal(0, turn / 2, 3)
    return told, (told[0] + rng.normal(0, shift, 3),
                  product((*half, math.sqrt(1 - half @ half)), told[1]))


def test_a_moving_sensor_off_its_place_leaves_ground_that_nobody_touched():
    changed = {"fixed": 0, "moving": 0}
    for seed in range(6):
        rng = np.random.default_rng(seed)
        told, there = jolted(rng, 0.03, 0.008)
        for which, sigmas in (("fixed", {}), ("moving", {"pose_shift_sigma": 0.03,
                                                         "pose_turn_sigma": 0.008})):
            site = dig(seed)
            before = site.height_map(origin=(-3, -2.5), shape=(51, 61), cell=VOXEL)
            depth = soilvdb.depth_image(site, camera(*there), SHAPE, INTRINSICS)
            for _ in range(6):
                site.scan(camera(*told, **sigmas), depth=depth, intrinsics=INTRINSICS)
            site.apply_scans()
            after = site.height_map(origin=(-3, -2.5), shape=(51, 61), cell=VOXEL)
            beside = np.abs(np.arange(51) * VOXEL - 2.5) > 1.5
            changed[which] += int((after != before)[beside].sum())
    assert changed["moving"] == 0 < changed["fixed"]


def test_the_order_of_scans_of_a_moving_sensor_does_not_show():
    true, rng = dig(2), np.random.default_rng(2)
    scans = []
    for k in range(4):
        told, there = jolted(rng)
        depth = soilvdb.depth_image(true, camera(*there), SHAPE, INTRINSICS, seed=k)
        scans.append((camera(*told, **MOVES), points_of(depth)))
    saved, fixed = set(), dig(2, 0.02)
    for _ in range(3):
        site = dig(2, 0.02)
        applied(site, [(sensor, rng.permutation(points))
                       for sensor, points in (scans[k] for k in rng.permutation(len(scans)))])
        saved.add(site.save())
    applied(fixed, [(camera(), points) for _, points in scans])
    assert len(saved) == 1 and fixed.ground_hash() != site.ground_hash()


@pytest.mark.parametrize(("height", "is_fitted"), [(1.3, False), (3.5, True)])
def test_untouched_ground_tells_a_moving_sensors_mount_once(height, is_fitted):
    """Its sigmas are those of a fixed sensor with a looser mount, whether poses are fitted or not."""
    looser = {"mount_height_sigma": math.hypot(0.01, 0.02), "mount_tilt_sigma": math.hypot(0.002, 0.005)}
    down, found = ((0.0, 0.0, height), (1, 0, 0, 0)), []
    for sigmas in (MOVES, looser, {}):
        site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
        depth = soilvdb.depth_image(site, camera(*down), SHAPE, INTRINSICS)
        for _ in range(3):
            site.scan(camera(*down, **sigmas), depth=depth, intrinsics=INTRINSICS)
        assert site.apply_scans().rays["used"] == 3 * depth.size
        found.append(site.heights([(0.0, 0.0), (0.5, -0.2)], sigma=True)[1])
    if not is_fitted:
        np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3)
    assert (found[2] < 0.99 * found[0]).all()


def test_poses_that_are_fitted_tell_nothing_of_one_that_is_not():
    """A scan that sees the floor alone is as little sure after others that saw untouched ground."""
    floor, inside = ((0.0, 0.0, 1.0), (1, 0, 0, 0)), square(-0.5, -0.5, 1.0)
    sigmas = {"moving": [], "fixed": []}
    for which, moves in (("moving", MOVES), ("fixed", {})):
        for beside in (0, 3):
            site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
            for y in (-1.0, 0.0, 1.0):
                site.place(0, position=(-2, y, 0.5))
                site.update_path(0, positions=[(x, y, -0.3) for x in np.linspace(-2, 2, 41)])
            site.place(0, position=(-9, -9, 4))
            for place, turn in [((-8, 0, 3.5), looking(0.75, math.pi))] * beside + [floor]:
                there = camera(place, turn, **moves)
                site.scan(there, depth=soilvdb.depth_image(site, there, SHAPE, INTRINSICS),
                          intrinsics=INTRINSICS)
            site.apply_scans()
            sigmas[which].append(site.volume(inside, sigma=True).sigma_m3)
    assert sigmas["moving"][1] == pytest.approx(sigmas["moving"][0], rel=1e-3)
    assert sigmas["fixed"][1] < 0.9 * sigmas["fixed"][0]   # whose mount is the same


def test_the_sigmas_of_a_moving_sensor_stay_whether_its_poses_are_fitted_or_not():
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    low = camera((0.0, 0.0, 1.3), (1, 0, 0, 0), **MOVES)   # sees too little
    site.scan(low, depth=soilvdb.depth_image(site, low, SHAPE, INTRINSICS), intrinsics=INTRINSICS)
    with pytest.raises(ValueError, match="had other sigmas before"):
        site.scan(camera(pose_shift_sigma=0.03), np.zeros((0, 3)))


def test_where_ground_slopes_the_place_of_a_moving_sensor_counts():
    sigmas = []
    for slope in (0.0, 0.5):
        site = soilvdb.Site(VOXEL, soilvdb.plane(0.0, (slope, 0)), [soilvdb.Bucket(1, 1)])
        for name, moves in (("fixed", {}), ("shifts", {"pose_shift_sigma": 0.05}),
                            ("turns", {"pose_turn_sigma": 0.05})):
            seen = site.clone()
            there = camera((-3, 0, 3), name=name, **moves)
            for _ in range(20):
                seen.scan(there, depth=soilvdb.depth_image(seen, there, SHAPE, INTRINSICS),
                          intrinsics=INTRINSICS)
            seen.apply_scans()
            sigmas.append(seen.heights([(0.0, 0.0), (1.0, 0.5)], sigma=True)[1])
    fixed, shifts, turns, fixed_up, shifts_up, turns_up = sigmas
    assert (shifts_up / fixed_up > 1.03 * shifts / fixed).all()
    assert (turns_up / fixed_up > 1.03 * turns / fixed).all()


def test_fitted_poses_are_nearly_as_good_as_known_ones():
    around = [(-2.2, -1.4), (2.2, -1.4), (2.2, 1.4), (-2.2, 1.4)]
    errors = {"told": [], "known": [], "fitted": []}
    for seed in range(8):
        rng = np.random.default_rng(100 + seed)
        shift, turn = rng.uniform(0.01, 0.03), rng.uniform(0.002, 0.008)
        believed, true = dig(seed, 0.02 * rng.normal()), dig(seed)
        poses = [jolted(rng, shift, turn, angle) for angle in rng.uniform(0, 2 * math.pi, 3)]
        images = [points_of(soilvdb.depth_image(true, camera(*there), SHAPE, INTRINSICS, seed=k))
                  for k, (_, there) in enumerate(poses)]
        exact = true.volume(around).net_m3
        for which, sigmas in (("told", {}), ("known", {}), ("fitted", {
                "pose_shift_sigma": shift, "pose_turn_sigma": turn})):
            site = believed.clone()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")   # of rays that miss the ground
                applied(site, [(camera(*(there if which == "known" else told), **sigmas), points)
                               for (told, there), points in zip(poses, images)])
            errors[which].append(site.volume(around).net_m3 - exact)
    told, known, fitted = (math.sqrt(np.mean(np.square(e))) for e in errors.values())
    assert fitted < 0.7 * told and fitted < 1.25 * known, (told, known, fitted)


def test_the_ledger_closes_with_what_was_surveyed(scene):
    site, scans = scene.believed(), scene.scans
    ledger, volume, was = site.ledger(), site.volume(AROUND), site.change_m3()
    survey = applied(site, scans)
    net = survey.added_m3 - survey.removed_m3
    if scene.soil is None:
        assert net < 0, "the trench is deeper than the machine reported"
    assert site.change_m3() - was == pytest.approx(net, abs=SAMPLE_M3 / 2)
    after = site.volume(AROUND)
    assert after.net_m3 - volume.net_m3 == pytest.approx(net, abs=SAMPLE_M3 / 2)
    assert ledger["surveyed_removed_m3"] == ledger["surveyed_added_m3"] == 0
    assert site.ledger() == {**ledger, "surveyed_removed_m3": survey.removed_m3,
                             "surveyed_added_m3": survey.added_m3}
    assert "surveyed_added_m3" not in site.ledger(0), "no machine did it"
    if scene.soil is None:
        assert after.net_m3 == pytest.approx(net - ledger["cut_m3"], abs=SAMPLE_M3)
    assert survey.sigma_m3 > 0


def test_heights_and_lip_come_nearer_to_the_truth(scene):
    site, scans = scene.believed(), scene.scans
    xy = np.stack(np.meshgrid(np.arange(-1, 1.01, 0.1), [-0.2, 0.0, 0.2]), axis=-1).reshape(-1, 2)
    exact = scene.true.heights(xy)
    before, unsure = site.heights(xy, sigma=True)
    np.testing.assert_array_equal(before, site.heights(xy))
    mean, sigma = applied(site, scans).lip_error[0]
    assert 0.005 < mean < 0.035 and abs(mean - 0.02) < 3 * sigma and sigma < 0.02
    after, sure = site.heights(xy, sigma=True)
    assert np.abs(after - exact).mean() < 0.6 * np.abs(before - exact).mean()
    assert after.shape == sure.shape == (len(xy),) and (sure > 0).all()
    assert np.median(sure) < np.median(unsure)
    nowhere = site.heights([(50.0, 50.0)], sigma=True)
    assert np.isnan(nowhere[0]).all() and np.isnan(nowhere[1]).all()


@pytest.mark.parametrize("shift", [-0.03, 0.05])
def test_a_sensor_that_hangs_higher_leaves_the_trench_as_deep(shift):
    believed, true = dig(5, 0.02), dig(5, 0.0)
    eye = camera(mount_height_sigma=0.5)
    told = camera((-4.0, 0.0, 3.5 + shift), mount_height_sigma=0.5)
    images = frames_of(true, eye, 4)
    floor = np.stack(np.meshgrid(np.arange(-0.6, 0.61, 0.1), [-0.1, 0.0, 0.1]), axis=-1).reshape(-1, 2)
    beside = np.stack(np.meshgrid(np.arange(-1.5, 1.6, 0.1), [-1.8, 1.8]), axis=-1).reshape(-1, 2)
    depths = []
    for sensor in (eye, told):
        site = believed.clone()
        applied(site, [(sensor, points_of(image)) for image in images])
        depths.append(site.heights(beside).mean() - site.heights(floor).mean())
    # Columns stay as they are if less than 4 samples of a voxel's 64 would change: 2 in the mean.
    assert depths[0] == pytest.approx(depths[1], abs=2 * VOXEL / 64)


def block(out):
    """Level ground with a dug strip, its ranges with a box of 1 m3 taken out or put down, and a camera
    above."""
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE)])
    site.update_path(0, positions=[(x, -2.5, -0.2) for x in np.linspace(-2, 0, 21)])
    site.place(0, position=(-6, -3, 3))
    shape, intrinsics = (360, 480), (260.0, 260.0, 239.5, 179.5)
    eye = np.array([0.45, 0.45, 4.0])
    sensor = soilvdb.Sensor(position=eye, rotation=(1, 0, 0, 0), range_sigma=0.005)
    u, v = np.meshgrid((np.arange(480) - 239.5) / 260, (np.arange(360) - 179.5) / 260)
    ways = np.stack([u, -v, -np.ones(shape)], axis=-1)   # one metre down each
    # 10 x 10 columns, which stand on multiples of the voxel.
    low = np.array([-0.05, -0.05, -1.0 if out else 0.0])
    high = np.array([0.95, 0.95, 0.0 if out else 1.0])
    depth = soilvdb.depth_image(site, sensor, shape, intrinsics)
    with np.errstate(divide="ignore"):
        a, b = (low - eye) / ways, (high - eye) / ways
    enter, leave = np.minimum(a, b).max(axis=-1), np.maximum(a, b).min(axis=-1)
    if out:
        at = eye[:2] + eye[2] * ways[..., :2]
        inside = ((at > low[:2]) & (at < high[:2])).all(axis=-1)
        depth = np.where(inside, leave, depth)
    else:
        depth = np.where(enter < leave, np.minimum(enter, depth), depth)
    return site, sensor, depth, intrinsics


@pytest.mark.parametrize("out", [True, False], ids=["out", "down"])
def test_a_block_of_one_cubic_metre_is_surveyed(out):
    site, sensor, depth, intrinsics = block(out)
    load, cut = site.ledger()["bucket_m3"], site.ledger()["cut_m3"]
    assert load > 0.3
    for _ in range(8):
        site.scan(sensor, depth=depth, intrinsics=intrinsics)
    survey = site.apply_scans()
    booked, other = survey.removed_m3, survey.added_m3
    if not out:
        booked, other = other, booked
    assert booked == pytest.approx(1.0, abs=0.005) and other < 0.005
    assert site.ledger()["bucket_m3"] == load and site.ledger()["cut_m3"] == cut
    assert survey.rays["through" if out else "new"] > 100


def sparse(depth, rng, share=0.01, dust=0.02):
    """A few pixels of an image; some end before the ground, anywhere."""
    some = np.where(rng.random(depth.shape) < share, depth, np.nan)
    return np.where(rng.random(depth.shape) < dust, some * rng.uniform(0.4, 0.99, depth.shape), some)


@pytest.mark.parametrize("out", [True, False], ids=["out", "down"])
def test_sparse_scans_that_are_applied_one_by_one_find_new_ground(out):
    site, sensor, depth, intrinsics = block(out)
    was = soilvdb.depth_image(site, sensor, depth.shape, intrinsics)
    rng = np.random.default_rng(7)
    for image, volume in ((depth, 1.0), (was, 0.0)):   # there it is, and gone again
        for _ in range(60):
            site.scan(sensor, depth=sparse(image, rng), intrinsics=intrinsics)
            survey = site.apply_scans()
            assert min(survey.rays.values()) >= 0
            copy = site.clone()
            copy.restore(site.save())
            site = copy
        change = site.volume(AROUND)
        assert abs(change.net_m3 + site.ledger()["cut_m3"]) == pytest.approx(volume, abs=0.03)


def test_dust_makes_no_ground_however_often_scans_are_applied():
    site, sensor, _, intrinsics = block(True)
    ground = soilvdb.depth_image(site, sensor, (360, 480), intrinsics)
    rng = np.random.default_rng(8)
    for _ in range(60):
        site.scan(sensor, depth=sparse(ground, rng), intrinsics=intrinsics)
        survey = site.apply_scans()
        assert survey.rays["new"] == 0 < survey.rays["dropped"]
    # Dust just above the ground is noise of it.
    assert abs(site.volume(AROUND).net_m3 + site.ledger()["cut_m3"]) < 0.02


def test_soil_that_rays_passed_comes_down_to_the_lowest_of_them():
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    site.place(0, position=(-8, -8, 4))
    eye, floor = np.array([-4.0, 0.0, 3.0]), over(site, -1.0, (2.0, -0.5), (3.0, 0.5), noise=0)
    sensor = soilvdb.Sensor(position=eye, range_sigma=0.004)
    for _ in range(3):
        site.scan(sensor, floor, world=True)
    site.apply_scans()
    x = np.arange(1.0, 1.75, VOXEL)
    lowest = 3 - 4 * (x + 4) / 6   # of the rays that end at x = 2
    heights = site.heights(np.stack([x, 0 * x], axis=1))
    # Within a column a ray falls by 2/3 of its width.
    assert np.abs(heights - lowest).max() < VOXEL * 2 / 3


@pytest.mark.parametrize("level", [0.3, -0.3], ids=["up", "down"])
def test_few_rays_of_a_column_are_enough_if_those_about_it_agree(level):
    x, y = (a.ravel() for a in np.meshgrid(VOXEL * np.arange(10), VOXEL * np.arange(10)))
    moved = np.stack([x, y, np.full(100, level)], axis=1)
    rough = moved.copy()
    rough[:, 2] += 0.3 * (np.arange(100) % 10 % 3 - 1) + 0.1 * (np.arange(100) // 10 % 3)
    as_told = np.concatenate([moved, *[moved * (1, 1, 0)] * 2])   # most rays say it is as it was
    # Twelve must end about a column: of two rays a column those at the corners are too few.
    for points, scans, columns in ((moved, 3, 100), (moved, 2, 96), (moved, 1, 0), (moved[:1], 3, 0),
                                   (rough, 3, 0), (as_told, 3, 0)):
        site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
        site.place(0, position=(-8, -8, 4))
        for _ in range(scans):
            site.scan(ABOVE, points, world=True)
        site.apply_scans()
        assert site.volume(square(-1, -1, 3)).net_m3 == pytest.approx(
            level * columns * VOXEL**2, rel=0.03, abs=1e-6)
        if columns:
            assert 0.01 < site.heights([(0.4, 0.4)], sigma=True)[1][0] < 0.05   # so few rays


def test_applied_twice_is_applied_once(scene):
    site, scans = scene.believed(), scene.scans
    first = applied(site, scans)
    state = site.save()
    again = site.apply_scans()
    assert again.removed_m3 == again.added_m3 == 0
    assert site.save() == state
    assert again.lip_error[0] == first.lip_error[0]


def test_clones_and_restored_sites_continue_alike(scene):
    site, scans = scene.believed(), scene.scans
    applied(site, scans[:2])
    for sensor, points in scans[2:4]:   # not applied yet
        site.scan(sensor, points)
    restored = scene.believed()
    restored.restore(site.save())
    others = [site.clone(), restored]
    for other in (site, *others):
        applied(other, scans[4:])
        other.update(0, position=(0, 0.5, 1.5))
        other.update(0, position=(0.3, 0.5, -0.6))   # cuts, and begins an epoch
        applied(other, scans[:1])
    for other in others:
        assert other.save() == site.save()
        xy = [(0.2, 0.4), (1.0, 0.0), (-1.0, 1.5)]
        np.testing.assert_array_equal(other.heights(xy, sigma=True), site.heights(xy, sigma=True))


def test_nothing_comes_of_scans_that_see_nothing(scene):
    site, scans = scene.believed(), scene.scans
    sensor = scans[0][0]
    other = site.clone()
    nothing = np.concatenate([np.full((50, 3), np.nan), np.zeros((50, 3))])
    for each, extra in ((site, nothing[:0]), (other, nothing)):
        applied(each, [(s, np.concatenate([extra, p, extra])) for s, p in scans])
    assert other.save() == site.save()
    survey, without = applied(site, [(sensor, nothing), (sensor, nothing[:0])]), other.apply_scans()
    assert (survey.removed_m3, survey.added_m3) == (without.removed_m3, without.added_m3)
    assert site.save() == other.save()


def test_all_forms_of_a_scan_say_the_same():
    believed, true = dig(6, 0.02), dig(6, 0.0)
    eye = camera()
    images = frames_of(true, eye, 3)
    x, y, z, w = eye.rotation
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    sites = [believed.clone() for _ in range(4)]
    for image in images:
        points = points_of(image)
        sites[0].scan(eye, depth=image, intrinsics=INTRINSICS)
        sites[1].scan(eye, points)
        sites[2].scan(eye, points @ turn.T + eye.position, world=True)
        sites[3].scan(eye, depth=image.astype(np.float32), intrinsics=INTRINSICS)
    removed = [site.apply_scans().removed_m3 for site in sites]
    assert removed[0] > 0
    # Rounding may move a ray by a unit of its sum, and that a column by a sample or two.
    np.testing.assert_allclose(removed, removed[0], rtol=0.02)


def test_a_bucket_in_view_is_not_ground():
    site = dig(7, buckets=2)
    site.place(1, position=(0.3, 0.0, 1.0))
    eye = camera()
    depth = soilvdb.depth_image(site, eye, SHAPE, INTRINSICS)
    # The camera sees the bucket's middle, 0.45 m above its lip, as a disc in front of the ground.
    u, v = np.meshgrid(np.arange(SHAPE[1]), np.arange(SHAPE[0]))
    x, y, z, w = eye.rotation
    towards = np.array([0.3 - 0.4, 0.0, 1.45]) - eye.position
    axes = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
                     [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
                     [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]])
    at = axes @ towards
    on_body = np.hypot(u - 80 * at[0] / at[2] - 63.5, v - 80 * at[1] / at[2] - 47.5) < 80 * 0.25 / at[2]
    assert on_body.sum() > 30
    depth[on_body] = at[2]
    was = site.ground_hash()
    for _ in range(10):
        site.scan(eye, depth=depth, intrinsics=INTRINSICS)
    survey = site.apply_scans()
    assert survey.rays["masked"] >= 10 * on_body.sum()
    assert site.ground_hash() == was


NAN = float("nan")


@pytest.mark.parametrize("wrong", [
    {"position": (0, 0, NAN)}, {"position": (0, 0)}, {"rotation": (0, 0, 0, 0)},
    {"rotation": (0, NAN, 0, 1)}, {"rotation": (0, 0, 1)}, {"range_sigma": -0.01}, {"range_sigma": NAN},
    {"range_squared_sigma": -1e-3}, {"mount_height_sigma": -0.01}, {"mount_tilt_sigma": -1},
    {"mount_scale_sigma": NAN}, {"pose_shift_sigma": -0.01}, {"pose_turn_sigma": NAN},
    {"pose_turn_sigma": 11}, {"max_range": 0}, {"max_range": -1}, {"max_range": NAN}, {"max_range": 1001}])
def test_wrong_sensors_are_refused(wrong):
    site = dig(8)
    state = site.save()
    with pytest.raises(ValueError):
        site.scan(soilvdb.Sensor(**{"position": (0, 0, 4), **wrong}), np.ones((4, 3)))
    assert site.save() == state


@pytest.mark.parametrize("wrong", [
    {"points": np.ones(3)}, {"points": np.ones((4, 2))}, {"points": np.ones((2, 3, 3))},
    {"depth": np.ones(4), "intrinsics": INTRINSICS}, {"depth": np.ones((4, 4, 1)), "intrinsics": INTRINSICS},
    {"depth": np.ones((4, 4)), "intrinsics": (1, 1, 0)},
    {"depth": np.ones((4, 4)), "intrinsics": (0, 1, 0, 0)},
    {"depth": np.ones((4, 4)), "intrinsics": (NAN, 1, 0, 0)},
    {"depth": np.ones((4, 4)), "points": np.ones((4, 3)), "intrinsics": INTRINSICS},
    {"depth": np.ones((4, 4))}, {}])
def test_wrong_scans_are_refused(wrong):
    site = dig(8)
    state = site.save()
    with pytest.raises(ValueError if len(wrong) == 2 or "points" in wrong and len(wrong) == 1
                       else TypeError):   # an argument is missing, or there are too many
        site.scan(camera(), **wrong)
    assert site.save() == state
    assert site.apply_scans().removed_m3 == 0


def test_points_in_the_world_need_the_sensors_position():
    site, unplaced = dig(8), soilvdb.Sensor(name="mast")
    for sensor in (unplaced, pickle.loads(pickle.dumps(unplaced))):
        with pytest.raises(ValueError, match="^sensor 'mast' has no position, where rays to points in the world begin"):
            site.scan(sensor, np.ones((4, 3)), world=True)
    for placed in (soilvdb.Sensor(position=(0, 0, 0)), soilvdb.Sensor(pose=np.eye(4))):
        for sensor in (placed, pickle.loads(pickle.dumps(placed))):
            site.scan(sensor, np.ones((4, 3)), world=True)
    site.scan(unplaced, np.ones((4, 3)))
    moving = pickle.loads(pickle.dumps(soilvdb.Sensor(pose_shift_sigma=0.02, pose_turn_sigma=0.005)))
    assert (moving.pose_shift_sigma, moving.pose_turn_sigma, moving.max_range) == (0.02, 0.005, math.inf)
    assert pickle.loads(pickle.dumps(soilvdb.Sensor(max_range=30))).max_range == 30


def test_simulated_images_have_the_sensors_noise():
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    down = soilvdb.Sensor(position=(0, 0, 4), rotation=(1, 0, 0, 0), range_sigma=0.02,
                          range_squared_sigma=0.0)
    exact = soilvdb.depth_image(site, down, (60, 80), (300, 300, 39.5, 29.5))
    np.testing.assert_allclose(exact, 4.0, atol=1e-6)
    noisy = soilvdb.depth_image(site, down, (60, 80), (300, 300, 39.5, 29.5), seed=1)
    assert (noisy == soilvdb.depth_image(site, down, (60, 80), (300, 300, 39.5, 29.5), seed=1)).all()
    assert (noisy - exact).std() == pytest.approx(0.02, rel=0.05)
    stereo = soilvdb.Sensor(position=(0, 0, 4), rotation=(1, 0, 0, 0), range_sigma=0.0,
                            range_squared_sigma=0.002)
    errors = soilvdb.depth_image(site, stereo, (300, 400), (3000, 3000, 199.5, 149.5), seed=2) - 4
    assert errors.std() == pytest.approx(0.032, rel=0.05)
    of_patch = errors.reshape(60, 5, 80, 5).mean(axis=(1, 3))
    # 0.8 of it in common, 0.6 by each of 25.
    assert of_patch.std() == pytest.approx(0.032 * math.sqrt(0.64 + 0.36 / 25), rel=0.05)
    up = soilvdb.Sensor(position=(0, 0, 4), rotation=(0, 0, 0, 1))
    assert np.isnan(soilvdb.depth_image(site, up, (4, 4), (9, 9, 1.5, 1.5), seed=1)).all()


def test_simulated_lidars_have_the_sensors_noise():
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    lidar = soilvdb.Sensor(position=(1, 2, 3), range_sigma=0.02)
    points = soilvdb.lidar_turn(site, lidar, 16, 360)
    assert points.shape == (16 * 360, 3)
    assert np.isnan(points[8 * 360:]).all() and np.isfinite(points[:8 * 360]).all()
    np.testing.assert_allclose(points[:8 * 360, 2], -3, atol=1e-6)
    assert points[0, 0] > 0 and abs(points[0, 1]) < 1e-9 and points[90, 1] > 0
    noisy = soilvdb.lidar_turn(site, lidar, [-0.5, -0.3], 1000, seed=3)
    assert noisy.shape == (2000, 3)
    ranges = np.linalg.norm(noisy, axis=1)
    assert (ranges[:1000] - 3 / math.sin(0.5)).std() == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize(("function", "arguments", "kind"), [
    ("depth_image", {"shape": (0, 4)}, ValueError), ("depth_image", {"shape": 5}, ValueError),
    ("depth_image", {"shape": (4, 4.5)}, ValueError), ("depth_image", {"seed": -1}, ValueError),
    ("depth_image", {"intrinsics": (1, 1, 0)}, ValueError),
    ("depth_image", {"intrinsics": (0, 1, 0, 0)}, ValueError),
    ("depth_image", {"intrinsics": (1, NAN, 0, 0)}, ValueError),
    ("depth_image", {"sensor": 5}, TypeError),
    ("lidar_turn", {"beams": 0}, ValueError), ("lidar_turn", {"beams": [2.0]}, ValueError),
    ("lidar_turn", {"beams": "many"}, ValueError), ("lidar_turn", {"steps": 1.5}, ValueError),
    ("lidar_turn", {"site": None}, TypeError), ("lidar_turn", {"seed": 0.5}, ValueError)])
def test_wrong_simulations_are_refused(function, arguments, kind):
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    given = {"site": site, "sensor": soilvdb.Sensor(position=(0, 0, 3))}
    if function == "depth_image":
        given |= {"shape": (4, 4), "intrinsics": (4, 4, 1.5, 1.5)}
    with pytest.raises(kind):
        getattr(soilvdb, function)(**{**given, **arguments})
    below = soilvdb.Sensor(position=(0, 0, -1))
    with pytest.raises(ValueError, match="below the ground"):
        getattr(soilvdb, function)(**{**given, "sensor": below})


def over(site, level, low, high, step=0.02, noise=0.004, seed=0):
    """Points of a level floor, world."""
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    z = level + noise * np.random.default_rng(seed).standard_normal(x.shape)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


ABOVE = soilvdb.Sensor(position=(1, 0, 5), range_sigma=0.004)


@pytest.mark.parametrize("points", [np.full((4, 3), 1e6), np.full((4, 3), 1e308)])
def test_points_too_far_away_are_refused(points):
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    with pytest.raises(ValueError, match="point 0 must be numbers, and within 1000 m"):
        site.scan(ABOVE, points)


@pytest.mark.parametrize("world", [False, True])
def test_points_beyond_a_sensors_range_are_counted_and_tell_nothing(world):
    eye = np.array([0.0, -3.5, 3.0])
    near = over(dig(8), 0.0, (-3, -3), (3, 3)) - (0 if world else eye)
    ranges = np.linalg.norm(near - (eye if world else 0), axis=1)
    reach = np.sort(ranges)[len(ranges) * 2 // 3]        # that point is within it
    out = near[ranges > reach]
    beyond = np.array([(0, 2000, 0), (1e7, 0, 0)])       # refused without a largest range
    given = {"position": eye, "range_sigma": 0.01}
    site, other = dig(8), dig(8)
    everything = np.concatenate([beyond, near])
    with pytest.raises(ValueError, match="within 1000 m"):
        site.scan(soilvdb.Sensor(**given), everything, world=world)
    site.scan(soilvdb.Sensor(**given, max_range=reach), everything, world=world)
    other.scan(soilvdb.Sensor(**given), near[ranges <= reach], world=world)
    survey, wanted = site.apply_scans(), other.apply_scans()
    assert survey.rays == {**wanted.rays, "far": len(out) + 2} and wanted.rays["far"] == 0
    assert pickle.loads(pickle.dumps(survey)).rays == survey.rays
    assert site.save() == other.save() and survey.rays["used"] > 100
    assert site.apply_scans().rays["far"] == 0, "since the last time"


def test_scans_all_of_whose_points_are_too_far_are_told():
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [])
    site.scan(soilvdb.Sensor(position=(0, 0, 5), max_range=4.0), [(0, 0, -5.0), (1, 0, -5.0)])
    with pytest.warns(UserWarning, match="all points of scans are beyond their sensor's max_range"):
        assert site.apply_scans().rays["far"] == 2


def test_what_makes_scans_see_too_much_ground_is_told():
    """Far points of a lidar; with a largest range they are no more than others."""
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [])
    x, y = np.meshgrid(np.arange(-260, 260, 2.0), np.arange(-260, 260, 2.0))    # 67 600 squares of 0.8 m
    far = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -4.0)])
    with pytest.raises(ValueError, match="65536 squares of 8 x 8 voxels, .* give the sensor a max_range, in m, or"):
        site.scan(soilvdb.Sensor(name="a", position=(0, 0, 4), range_sigma=0.01), far)
    site.scan(soilvdb.Sensor(name="a", position=(0, 0, 4), range_sigma=0.01, max_range=50), far)
    assert site.apply_scans().rays["far"] > 60_000


def test_a_first_scan_gives_a_plane_its_place():
    site = soilvdb.Site(0.1, soilvdb.plane(431.85), [soilvdb.Bucket(1, 1)])
    far = soilvdb.Sensor(position=(512340, 5403640, 436), range_sigma=0.01)
    site.scan(far, np.zeros((0, 3)))
    site.update(0, position=(512345, 5403640, 433))
    site.scan(far, over(site, 431.85, (512338, 5403638), (512342, 5403642)), world=True)
    assert site.apply_scans().rays["used"] > 10_000
    z, sigma = site.heights([(512340, 5403640)], sigma=True)
    assert z[0] == pytest.approx(431.85, abs=0.01) and 0 < sigma[0] < 0.01


def two_machines(soil=None, ask=False):
    """Machine 0 digs with a lip told 4 cm too high; machine 1 passes through the air far away."""
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)] * 2, soil=soil)
    site.scan(ABOVE, np.zeros((0, 3)))
    if ask:
        site.heights([(1.0, 0.0)], sigma=True)
    for x in np.linspace(-1, 3, 41):
        site.update(0, position=(x, 0, -0.16))
        if ask:
            site.heights([(x, 0.0)], sigma=True)
    site.place(0, position=(-8, -8, 4))
    site.place(1, position=(1, 9, 2))
    site.update(1, position=(1.1, 9, 2))
    for seed in range(3):
        site.scan(ABOVE, np.concatenate([over(site, -0.2, (0, -0.5), (2, 0.5), seed=seed),
                                         over(site, 0.0, (0, 1), (2, 2), seed=seed)]), world=True)
    return site, site.apply_scans()


@pytest.mark.parametrize("moving", [False, True])
def test_a_machine_that_touched_nothing_is_told_nothing_of(moving):
    soil = soilvdb.Soil(repose_angle=0.6) if moving else None
    _, survey = two_machines(soil)
    assert survey.lip_error[1] == pytest.approx((0, 0.02), abs=1e-6)
    mean, sigma = survey.lip_error[0]
    assert abs(mean - 0.04) < 3 * sigma and sigma < 0.01


def test_looking_changes_nothing():
    soil = soilvdb.Soil(repose_angle=0.6)
    assert two_machines(soil)[0].ground_hash() == two_machines(soil, ask=True)[0].ground_hash()


def test_what_comes_after_a_scan_stays():
    soil = soilvdb.Soil(repose_angle=0.6)
    sites = []
    for applies_first in (True, False):
        site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)], soil=soil,
                            pours=[soilvdb.Pour(at=(0.3, 0, 3), time=(1, 2), volume=0.5)])
        oblique = soilvdb.Sensor(position=(-3, 0, 2), range_sigma=0.005)
        for seed in range(3):
            site.scan(oblique, over(site, -0.6, (0.8, -0.2), (1.2, 0.2), step=0.01, seed=seed),
                      world=True)
        if applies_first:
            site.apply_scans()
        site.pour(2.5)
        if not applies_first:
            site.apply_scans()
        sites.append(site.heights([(0.5, 0.0)])[0])  # over the rays' way through the ground
    assert sites[0] > 0.2 and sites[1] > sites[0] - 0.05


def test_one_name_is_one_sensor():
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    site.scan(ABOVE, over(site, 0.0, (0, 0), (1, 1)), world=True)
    with pytest.raises(ValueError, match="'sensor' had other sigmas before"):
        site.scan(soilvdb.Sensor(position=(1, 0, 5), range_sigma=0.1), np.zeros((0, 3)))


def test_reflections_in_water_dig_nothing():
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1, 1)])
    low = soilvdb.Sensor(position=(0, 0, 2), range_sigma=0.005)
    site.scan(low, np.repeat([[900.0, 3.0, -20.0]], 500, axis=0), world=True)
    assert site.apply_scans().removed_m3 == 0


def floor_told(site, level, seeds, natural=True):
    """Scans of a floor, and of the ground beside it."""
    for seed in seeds:
        parts = [over(site, level, (0, -0.5), (2, 0.5), seed=seed)] if level is not None else []
        if natural:
            parts.append(over(site, 0.0, (0, 1), (2, 2), seed=seed))
        site.scan(ABOVE, np.concatenate(parts), world=True)
    return site.apply_scans()


def told_too_high(deeper=0.16, site=None):
    """A floor that is told 4 cm too high."""
    site = site or soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    site.place(0, position=(-1.1, 0, 0.5))
    for x in np.linspace(-1, 3, 41):
        site.update(0, position=(x, 0, -deeper))
    site.place(0, position=(-8, -8, 4))
    return site


def test_scans_after_a_correction_confirm_it():
    site = told_too_high()
    first = floor_told(site, -0.2, range(4))
    middle, seen = [(1.0, 0.0), (0.5, 0.2), (1.5, -0.2)], [(0, -.5), (1.9, -.5), (1.9, .5), (0, .5)]
    assert site.heights(middle) == pytest.approx(-0.2, abs=0.006)
    net = site.volume(seen).net_m3
    again = floor_told(site, -0.2, range(10, 14))
    assert site.heights(middle) == pytest.approx(-0.2, abs=0.006)
    assert abs(site.volume(seen).net_m3 - net) < 0.02 * first.removed_m3
    mean, sigma = first.lip_error[0]
    assert again.lip_error[0][0] == pytest.approx(mean, abs=sigma)


def test_what_is_known_of_a_lip_outlives_its_floor():
    site = told_too_high()
    mean, sigma = floor_told(site, -0.2, range(4)).lip_error[0]
    assert mean == pytest.approx(0.04, abs=3 * sigma) and sigma < 0.01
    told_too_high(0.4, site)  # every column that was seen is dug away
    later = floor_told(site, None, range(3)).lip_error[0]
    assert later[0] == pytest.approx(mean, abs=0.003) and later[1] < 0.012


def test_the_sigma_of_what_was_not_corrected_has_its_error_in_it():
    site = told_too_high()
    hidden, seen = [(-0.8, 0.0), (2.8, 0.0)], [(1.0, 0.0), (0.5, 0.2)]
    survey = floor_told(site, -0.2, range(4))
    heights, sigmas = site.heights(hidden, sigma=True)
    assert heights == pytest.approx(-0.16, abs=0.002)   # which is 4 cm too high
    assert np.all(sigmas > 0.03)
    assert np.all(site.heights(seen, sigma=True)[1] < 0.01)
    # Half a sample's layer is left as it is: the volume is not known better for it.
    exact = told_too_high(0.2 + 0.05 / 40)
    same = floor_told(exact, -0.2, range(4))
    assert same.removed_m3 + same.added_m3 < 0.1 * (survey.removed_m3 + survey.added_m3)
    assert same.sigma_m3 > 0.5 * survey.sigma_m3


def square(x, y, side):
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


def test_the_sigma_of_a_volume_before_any_scan_is_that_of_the_lip_and_the_floor():
    site = told_too_high()
    # All of a volume errs with the lip, 20 mm; the floor, 7.5 mm, alike in each square of 2 m.
    volume = site.volume(square(0.2, -0.5, 1.0), sigma=True)
    assert repr(volume).endswith(f", sigma_m3={volume.sigma_m3:.2g})")
    assert "sigma_m3" not in repr(site.volume(square(0.2, -0.5, 1.0)))
    assert volume.sigma_m3 == pytest.approx(math.hypot(0.02, 0.0075 * math.sqrt(0.5)), rel=0.02)
    assert site.volume(square(0.2, 0.05, 0.5), sigma=True).sigma_m3 == pytest.approx(
        0.25 * math.hypot(0.02, 0.0075), rel=0.02)
    assert site.volume(square(0.2, 1.5, 1.0), sigma=True).sigma_m3 == 0   # nobody touched it
    assert site.volume(square(0.2, -0.5, 1.0)).sigma_m3 is None


def test_the_error_of_a_volume_is_as_large_as_its_sigma_says():
    shares = []
    for seed in range(20, 36):
        rng = np.random.default_rng(seed)
        true = dig(seed)
        believed = dig(seed, rng.normal(0, 0.02))
        hung = camera((-4, 0, 3.5 + rng.normal(0, 0.01)), looking(0.75 + rng.normal(0, 0.002)))
        for image in frames_of(true, hung, 4, 10 * seed):
            believed.scan(camera(), points_of(image))
        believed.apply_scans()
        for place in [(-0.8, -0.3), (0.0, -0.3), (-0.4, 0.0)]:
            boundary = square(*place, 0.5)
            volume = believed.volume(boundary, sigma=True)
            shares.append((volume.net_m3 - true.volume(boundary).net_m3) / volume.sigma_m3)
    assert np.max(np.abs(shares)) < 4
    assert 0.3 < np.sqrt(np.mean(np.square(shares))) < 1.5


def test_ground_of_which_few_rays_tell_has_a_sigma_as_large_as_its_error():
    sensor, rng = camera((2, -1, 5), looking(1.2)), np.random.default_rng(11)
    x, y = (a.ravel() for a in np.meshgrid(np.arange(0, 4, VOXEL) + 0.01, np.arange(-2, 2, VOXEL) + 0.01))
    shares = []
    for _ in range(8):
        radius, depth, pit = rng.uniform(0.5, 0.9), rng.uniform(0.25, 0.5), rng.uniform((1, -1), (3, 1))
        inside = np.hypot(x - pit[0], y - pit[1]) < radius
        ends = np.stack([x, y, -depth * inside * rng.uniform(0.5, 1.5, x.shape)], 1)
        # Two rays for each column of a rough pit don't tell how high that is.
        site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
        site.place(0, position=(-8, -8, 4))
        for _ in range(2):
            way = ends - sensor.position
            ranges = np.linalg.norm(way, axis=1, keepdims=True)
            site.scan(sensor, sensor.position + way * (1 + rng.normal(0, 0.004, ranges.shape) / ranges),
                      world=True)
        site.apply_scans()
        volume = site.volume(square(-0.5, -2.5, 5.0), sigma=True)
        shares.append((volume.net_m3 - ends[:, 2].sum() * VOXEL**2) / volume.sigma_m3)
    assert np.max(np.abs(shares)) < 4
    assert 0.1 < np.sqrt(np.mean(np.square(shares))) < 2


def pouring(z=0.0, volume=1.0):
    return soilvdb.Site(VOXEL, soilvdb.plane(z), [soilvdb.Bucket(1.2, 0.9)], soil=LOAM,
                        pours=[soilvdb.Pour(at=(1, 0, 3), time=(1, 2), volume=volume)])


def test_soil_that_comes_onto_scanned_ground_has_a_sigma():
    sites = [pouring(), pouring()]
    for site in sites:
        site.place(0, position=(-8, -8, 4))
    sites[0].scan(ABOVE, over(sites[0], 0.0, (-1, -2), (3, 2)), world=True)
    sites[0].apply_scans()
    sigmas = []
    for site in sites:
        site.pour(3)
        site.come_to_rest()
        sigmas.append(site.volume(square(-2, -3, 6), sigma=True).sigma_m3)
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.1) and sigmas[1] > 0.01


def test_soil_on_ground_that_scans_found_is_known_as_well_as_both():
    site = pouring(volume=0.1)
    site.place(0, position=(-8, -8, 4))
    for seed in range(3):   # the ground is half a metre lower than anybody said
        site.scan(ABOVE, over(site, -0.5, (-1, -2), (3, 2), step=0.04, seed=seed), world=True)
    site.apply_scans()
    middle = [(1.0, 0.0)]
    before, known = site.heights(middle, sigma=True)
    site.pour(3)
    site.come_to_rest()
    after, sigma = site.heights(middle, sigma=True)
    thick = after[0] - before[0]
    # Beside steep flanks a quarter of the bend comes to it.
    assert thick > 0.1 and known[0] < 0.02 and 0.1 * thick < sigma[0] < 0.3 * thick
    part, whole = (site.volume(square(1 - side / 2, -side / 2, side), sigma=True).sigma_m3
                   for side in (0.4, 1.6))
    assert part < whole


@pytest.mark.parametrize("seed", range(4))
def test_sigmas_of_parts_hold_for_the_whole(seed):
    site = told_too_high()
    floor_told(site, -0.46 if seed % 2 else -0.2, [seed, seed + 10])
    rng = np.random.default_rng(seed)
    cut = rng.uniform(0.3, 1.7)
    lower, upper = [(-0.5, -0.6), (cut, -0.6), (cut, 0.6), (-0.5, 0.6)], [
        (cut, -0.6), (2.5, -0.6), (2.5, 0.6), (cut, 0.6)]
    a, b, both = (site.volume(each, sigma=True).sigma_m3 for each in (
        lower, upper, [(-0.5, -0.6), (2.5, -0.6), (2.5, 0.6), (-0.5, 0.6)]))
    assert abs(a - b) * (1 - 1e-9) <= both <= (a + b) * (1 + 1e-9)


def test_a_boundary_may_be_larger_than_what_was_dug():
    site = told_too_high()
    floor_told(site, -0.2, range(2))
    sigmas = [site.volume(square(1 - side / 2, -side / 2, side), sigma=True).sigma_m3
              for side in (8.0, 40.0, 2000.0)]
    assert sigmas[0] > 0.001 and sigmas[1:] == pytest.approx([sigmas[0]] * 2, rel=1e-9)


def test_ground_that_was_found_to_be_another_tells_nothing_of_the_lip():
    def lip_of(settled):
        site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
        site.place(0, position=(-8, -8, 4))
        floor_told(site, -settled, range(3))
        told_too_high(0.3, site)
        return floor_told(site, -0.3, range(20, 23)).lip_error[0]
    (mean, sigma), (calm, _) = lip_of(0.055), lip_of(0.0)
    assert abs(mean - calm) < sigma


def test_the_order_of_three_sensors_does_not_show():
    def state(order):
        site = told_too_high()
        for name in order:
            sigma = {"a": 0.004, "b": 0.007, "c": 0.011}[name]
            sensor = soilvdb.Sensor(name=name, position=(1, 0, 5), range_sigma=sigma)
            site.scan(sensor, np.concatenate([
                over(site, -0.19, (0, -0.5), (2, 0.5), seed=ord(name)),
                over(site, 0.0, (0, 1), (2, 2), seed=ord(name))]), world=True)
        site.apply_scans()
        restored = told_too_high()
        restored.restore(site.save())
        assert restored.save() == site.save()
        return site.save()
    assert len({state(order) for order in itertools.permutations("abc")}) == 1


def test_a_restored_site_says_the_same_sigmas():
    site = told_too_high()
    floor_told(site, -0.2, range(2))
    site.place(0, position=(0, 1.5, 0.5))
    for x in np.linspace(0, 1, 11):
        site.update(0, position=(x, 1.5, -0.3))
    restored = told_too_high()
    restored.restore(site.save())
    x, y = np.meshgrid(np.arange(-1, 3, 0.05), np.arange(-1, 3, 0.05))
    places = np.column_stack([x.ravel(), y.ravel()])
    assert np.array_equal(*(each.heights(places, sigma=True)[1] for each in (site, restored)),
                          equal_nan=True)


def test_looking_at_sigmas_begins_no_survey():
    def scanned(looks):
        site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)] * 2)
        if looks:
            site.heights([(1, 0)], sigma=True)
            site.volume(AROUND, sigma=True)
        told_too_high(site=site)
        site.place(1, position=(-8, 8, 4))
        return floor_told(site, -0.2, range(2)), site.save()
    (looked, state), (not_looked, other) = scanned(True), scanned(False)
    assert state == other and looked.lip_error[0] == not_looked.lip_error[0]


def test_rays_that_do_not_fit_the_ground_are_told_once():
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    x, y = np.meshgrid(np.arange(-2, 2, 0.05), np.arange(-2, 2, 0.05))
    points = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1)
    high = soilvdb.Sensor(position=(0, 0, 4))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        site.scan(high, points, world=True)
        site.apply_scans()
    site.scan(high, points + (0, 0, 1), world=True)
    with pytest.warns(UserWarning, match="% of the rays do not meet the ground"):
        site.apply_scans()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        site.scan(high, points + (0, 0, 2.5), world=True)
        site.apply_scans()


def test_a_sensor_that_moves_as_if_its_poses_were_exact_is_warned_of_once():
    points = np.array([(0.1 * i, 0.1 * k, -2.0) for i in range(20) for k in range(20)])

    def scanned(site, x, **known):
        site.scan(soilvdb.Sensor(name="cab", position=(x, 0, 2), range_sigma=0.01, **known), points)

    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [])
    with pytest.warns(UserWarning, match="sensor 'cab' has moved, .* pose_shift_sigma") as told:
        for x in (0, 0, 1, 2):
            scanned(site, x)
            assert len(told) == (x >= 1)
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for x in (0, 1, 2):
            scanned(site, x, pose_shift_sigma=0.02)


def test_depths_in_millimetres_are_told():
    site = soilvdb.Site(0.1, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    with pytest.raises(ValueError, match=r"pixel \(0, 0\) has 1500.*millimetres"):
        site.scan(soilvdb.Sensor(), depth=np.full((4, 4), 1500, np.uint16), intrinsics=(4, 4, 2, 2))


def test_a_floor_beside_its_walls_errs_with_the_lip_as_well():
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 1.3)])
    site.update_path(0, positions=[(x, 0, -0.8) for x in np.linspace(-1, 3, 41)])
    site.place(0, position=(-8, -8, 4))
    walls = [(1.0, y) for y in (-0.6, -0.55, 0.55, 0.6)]   # half dug, and dug
    heights, sigmas = site.heights(walls, sigma=True)
    assert heights == pytest.approx([-0.4, -0.8, -0.8, -0.4], abs=0.005)
    lip = floor_told(site, -0.84, range(6)).lip_error[0][0]
    assert lip > 0.02
    after, after_sigmas = site.heights(walls, sigma=True)
    assert after - heights == pytest.approx([-lip / 2, -lip, -lip, -lip / 2], abs=0.004)
    assert np.all(after_sigmas[[0, 3]] < sigmas[[0, 3]])
    assert site.heights([(1.0, -0.65), (1.0, 0.65)]) == pytest.approx(0.0, abs=1e-6)   # the rim


def test_a_wall_errs_by_its_share_of_what_the_floor_errs_alike():
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 1.3)])
    site.update_path(0, positions=[(x, 0, -0.8) for x in np.linspace(-1, 13, 141)])
    site.place(0, position=(-8, -8, 4))
    walls = [(5.0, y) for y in (-0.6, -0.55, 0.55, 0.6)]   # half dug, and dug
    heights = site.heights(walls)
    for seed in range(3):   # as the lip left it, but for a square of 2 m
        site.scan(PRECISE, np.concatenate([over(site, level, (low, side), (high, side + 1), seed=seed)
                                           for level, low, high, side in (
                                               (0, 0, 12, 1), (-0.8, 0, 4, -0.5), (-0.812, 4, 6, -0.5),
                                               (-0.8, 6, 12, -0.5))]), world=True)
    assert abs(site.apply_scans().lip_error[0][0]) < 0.004
    by = site.heights(walls) - heights
    assert by[1] < -0.008
    assert by == pytest.approx([by[1] / 2, by[1], by[1], by[1] / 2], abs=2 * 0.05 / 64)   # samples


@pytest.mark.parametrize("off", [-0.02, 0.02])
def test_scans_of_level_ground_tell_nothing_of_a_cliff_that_no_ray_met(off):
    cliff = np.where(np.arange(-4, 4.05, 0.1) < 0.05, 1.0, 0.0).astype(np.float32)
    site = soilvdb.Site(0.05, soilvdb.raster(np.tile(cliff, (81, 1)), origin=(-4, -4), cell=0.1), [])
    seen = [(1 + off, -1.5, -0.2), (off, 0.3, 1.0), (off, 1.1, 1.5)]
    face, between = [(x, 0) for x in (-0.05, 0, 0.05, 0.1)], [(1.05, y) for y in (-1, 0, 1)]
    was = site.heights(face)
    for seed in range(3):
        site.scan(PRECISE, np.concatenate([over(site, level, (low, -1.5), (high, 1.5), seed=seed)
                                           for level, low, high in seen]), world=True)
    site.apply_scans()
    assert np.array_equal(site.heights(face), was)
    assert site.heights(between) == pytest.approx(off, abs=0.005)


@pytest.mark.parametrize("side", [-1, 1])
def test_ground_is_found_to_be_another_whatever_was_dug_beside_it(side):
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    site.update_path(0, positions=[(x, 0, -0.1) for x in np.linspace(-1, 3, 41)])
    site.place(0, position=(-8, -8, 4))
    # A ray tells so little that only those about it together say that the ground settled.
    coarse = soilvdb.Sensor(name="coarse", position=(1, 0, 5), range_sigma=0.02, mount_height_sigma=1e-4,
                            mount_tilt_sigma=1e-5, mount_scale_sigma=1e-6)
    strips = [(-0.1, -0.5, 0.5), (-0.04, 0.72, 1.0), (0.0, 1.2, 1.9)]   # dug, settled, as it was
    site.scan(coarse, np.concatenate([over(site, level, (0, low), (2, high), step=0.025, noise=0) * (1, side, 1)
                                      for level, low, high in strips]), world=True)
    site.apply_scans()
    x, y = np.meshgrid(np.arange(0.1, 1.9, 0.05), np.arange(0.75, 0.96, 0.05))
    assert site.heights(np.column_stack([x.ravel(), side * y.ravel()])) == pytest.approx(-0.04, abs=0.002)


def test_the_number_of_a_machine_does_not_show():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-1, 3, 0.05), np.arange(-0.7, 0.71, 0.05)))

    def told_of(machine):
        site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 1.3)] * 3)
        site.scan(ABOVE, np.zeros((0, 3)))   # from here on it is known which machine digs
        site.update_path(machine, positions=[(at, 0, -0.8) for at in np.linspace(-1, 3, 41)])
        for k in range(3):
            site.place(k, position=(-8, -8 - 3 * k, 4))
        survey = floor_told(site, -0.84, range(2))
        return survey.lip_error[machine], survey.sigma_m3, *site.heights(np.column_stack([x, y]), sigma=True)

    lip, sigma_m3, heights, sigmas = told_of(0)
    assert lip[0] > 0.02
    for other in map(told_of, (1, 2)):
        assert other[0] == pytest.approx(lip) and other[1] == pytest.approx(sigma_m3)
        assert np.abs(other[2] - heights).max() < 1.01 * 0.05 / 64   # a sample, by rounding
        assert np.abs(other[3] - sigmas).max() < 1e-6


def test_what_was_seen_stays_however_steep():
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)], soil=LOAM)
    for seed in range(2):
        site.scan(ABOVE, over(site, 0.6, (0.45, -0.45), (1.45, 0.45), seed=seed), world=True)
    assert site.apply_scans().added_m3 == pytest.approx(0.54, rel=0.02)
    was = site.ground_hash()
    for x in (9.0, 9.1):
        site.update(0, position=(x, 9, 3))
    site.come_to_rest()
    assert site.ground_hash() == was


@pytest.mark.parametrize("shift", [0.02, 0.03])
def test_rays_that_pass_a_rim_and_end_at_the_wall_behind_it_make_no_ground(shift):
    site = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 1.3)])
    site.update_path(0, positions=[(x, 0, -0.8) for x in np.linspace(-2, 2, 41)])
    site.place(0, position=(-6, -3, 3))
    eye = np.array([0.0, -2.5, 0.6])   # hangs higher than it is told
    ahead, up = np.meshgrid(np.linspace(-0.35, 0.35, 141), np.linspace(-0.6, -0.1, 201))
    ways = np.stack([np.sin(ahead) * np.cos(up), np.cos(ahead) * np.cos(up), np.sin(up)],
                    axis=-1).reshape(-1, 3)
    ranges = site.cast(eye + [0, 0, shift], ways)
    ends = (eye + ways * ranges[:, None])[np.isfinite(ranges)]
    sensor = soilvdb.Sensor(position=eye, range_sigma=0.01, mount_height_sigma=0.02)
    for _ in range(3):
        site.scan(sensor, ends, world=True)
    survey = site.apply_scans()
    assert survey.removed_m3 == survey.added_m3 == 0
    assert survey.rays["used"] > 0.9 * 3 * len(ends) and survey.rays["dropped"] > 1000


def passes(site, level, x=(0.0, 8.0)):
    """Digs a floor 3 m wide at a level."""
    for y in (-1.0, 0.0, 1.0):
        site.place(0, position=(x[0], y, 0.5))
        for at in np.linspace(*x, 81):
            site.update(0, position=(at, y, level))
    site.place(0, position=(-5, 20, 3))


PRECISE = soilvdb.Sensor(name="precise", position=(3, 0, 5), range_sigma=0.004, mount_height_sigma=0.001,
                         mount_tilt_sigma=1e-4, mount_scale_sigma=1e-5)


@pytest.mark.parametrize("width", [3.0, 1.0])   # of what is dug deeper: all, or a part of each block
def test_what_erred_alike_in_a_floor_says_nothing_of_the_next(width):
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    passes(site, -0.2)
    off = over(site, -0.185, (2.0, -1.5), (4.0, 1.5))     # 15 mm above what was told
    for seed in range(3):
        site.scan(PRECISE, np.concatenate([over(site, 0.0, (-4, 2.5), (8, 5), seed=seed), off,
                                           over(site, -0.2, (4.1, -1.2), (7.9, 1.2), seed=seed)]), world=True)
    site.apply_scans()
    if width == 3:
        passes(site, -0.4)
    else:
        site.place(0, position=(0, 0, 0.5))
        for at in np.linspace(0, 8, 81):
            site.update(0, position=(at, 0, -0.4))
        site.place(0, position=(-5, 20, 3))
    x, y = np.meshgrid(np.arange(2.05, 3.95, 0.03), np.arange(-0.55, 0.55, 0.2))
    places = np.stack([x.ravel(), y.ravel()], 1)
    own = np.column_stack([places, site.heights(places)])  # noise-free
    site.scan(PRECISE, own, world=True)
    done = site.apply_scans()
    assert max(done.removed_m3, done.added_m3) < 1e-4
    assert np.abs(site.heights(places) - own[:, 2]).max() < 1e-3


def test_a_floor_that_was_dug_anew_is_as_uncertain_as_one_that_was_never_scanned():
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9)])
    for x in ((0.0, 4.0), (10.0, 14.0)):   # the first is scanned
        passes(site, -0.2, x)
    site.scan(PRECISE, np.concatenate([over(site, 0.0, (-4, 2.5), (8, 5)),
                                       over(site, -0.2, (0.1, -1.5), (4.0, 1.5))]), world=True)
    site.apply_scans()
    for x in ((0.0, 4.0), (10.0, 14.0)):
        passes(site, -0.4, x)
    sigmas = [site.volume([(x, -1.4), (x + 3.8, -1.4), (x + 3.8, 1.4), (x, 1.4)], sigma=True).sigma_m3
              for x in (0.2, 10.2)]
    assert sigmas[0] == pytest.approx(sigmas[1], rel=0.02)
    assert sigmas[0] > 0.02 * 3.8 * 2.8 * 0.1
