# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Digs that sensors look at: the true ground in NumPy, the engine's prediction of it, rays, noise.

The true ground is an array of posts, linear between them, and rays are cast into it here: nothing
of the engine is in it. The prediction is a soilvdb.Site on a survey of the natural ground. It is dug
by the poses that the machine reports, which err by its lip, and a heap is poured on it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

# Whoever works on the fusion may look at draws of the development seeds only. The full benchmark
# draws from the held-out seeds, which differ in ground, trench, slump, heap and all errors.
DEVELOPMENT_SEEDS = range(1000, 1200)
HELD_OUT_SEEDS = range(900_000, 900_200)

CELL = 0.025                        # distance of the true ground's posts, m
ORIGIN, SIDES = (-2.0, -5.0), (14.0, 10.0)
COLUMN = 0.05                       # the engine's voxels, m; their columns stand on multiples of it
FIRST, COLUMNS = (0.05, -4.95), (199, 239)   # middle of the first column scored; rows, columns
WIDTH = 1.2                         # of the bucket that digs, m
PARKED = (-1.0, -4.0, 3.0)
# Standard deviations of the errors that a draw has, m, rad, shares.
LIP, LIP_DRIFT, LOCAL, FLOOR = 0.02, 0.005, 0.008, 0.004
MOUNT_HEIGHT, MOUNT_TILT, MOUNT_SCALE = 0.01, 0.002, 0.002
NO_RETURN, DUST, FLYING, MIRRORED = 0.03, 0.005, 0.3, 0.01


def smooth_field(rng, sigma, length):
    """A Gaussian random field at the posts, m: its values are alike over about `length`, m."""
    shape = (round(SIDES[1] / CELL) + 1, round(SIDES[0] / CELL) + 1)
    ky, kx = np.fft.fftfreq(shape[0], CELL), np.fft.rfftfreq(shape[1], CELL)
    blur = np.exp(-2 * (math.pi * length / 3) ** 2 * (ky[:, None] ** 2 + kx**2))
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(shape)) * blur, s=shape)
    return sigma * (field - field.mean()) / field.std()


def posts():
    """x (nx), y (ny) of the posts."""
    return tuple(ORIGIN[k] + CELL * np.arange(round(SIDES[k] / CELL) + 1) for k in (0, 1))


def columns_of(heights):
    """Mean heights of the columns scored, exact for ground that is linear between posts."""
    i, j = (round((FIRST[k] - ORIGIN[k]) / CELL) for k in (0, 1))
    rows, cols = COLUMNS
    h = heights[j - 1:j + 2 * rows, i - 1:i + 2 * cols]
    across = 0.25 * h[:, :-2:2] + 0.5 * h[:, 1:-1:2] + 0.25 * h[:, 2::2]
    return 0.25 * across[:-2:2] + 0.5 * across[1:-1:2] + 0.25 * across[2::2]


def between(field, x, y):
    """Linear between posts."""
    u = np.clip((x - ORIGIN[0]) / CELL, 0, field.shape[1] - 1.000001)
    v = np.clip((y - ORIGIN[1]) / CELL, 0, field.shape[0] - 1.000001)
    i, j = u.astype(np.int32), v.astype(np.int32)
    u, v = u - i, v - j
    flat, at = field.ravel(), j * field.shape[1] + i
    return ((1 - v) * ((1 - u) * flat[at] + u * flat[at + 1])
            + v * ((1 - u) * flat[at + field.shape[1]] + u * flat[at + field.shape[1] + 1]))


def cast(heights, origin, directions):
    """Ranges (N) of rays from one point along unit vectors (N, 3) to ground between posts; infinity
    if a ray leaves the area. Blocks of posts that lie below a ray are passed at once."""
    block = 8
    ny, nx = (n // block for n in (heights.shape[0] - 1, heights.shape[1] - 1))
    highest = np.full((ny, nx), -np.inf)
    for j in range(block + 1):
        for i in range(block + 1):
            np.maximum(highest, heights[j:j + block * ny:block, i:i + block * nx:block], highest)
    side, top = block * CELL, heights.max()
    out = np.full(len(directions), np.inf)
    d = directions.astype(float) + 1e-15
    with np.errstate(divide="ignore"):
        first = np.where(d[:, 2] < 0, np.maximum(0, (top - origin[2]) / d[:, 2]), 0)
    ray = np.flatnonzero((d[:, 2] < 0) | (origin[2] <= top))
    d, t = d[ray], first[ray]
    low = np.array(ORIGIN)
    stride = 0.5 * CELL / np.maximum(np.hypot(d[:, 0], d[:, 1]), 0.2)
    begins, ends, rays, ways = [], [], [], []
    while len(ray):
        x, y, z = (origin[k] + t * d[:, k] for k in range(3))
        p = np.floor((x - low[0]) / side).astype(np.int32)
        q = np.floor((y - low[1]) / side).astype(np.int32)
        inside = (p >= 0) & (q >= 0) & (p < nx) & (q < ny) & ((d[:, 2] < 0) | (z <= top))
        if not inside.all():
            ray, d, t, stride, x, y, z, p, q = (a[inside] for a in (ray, d, t, stride, x, y, z, p, q))
        out_x = (low[0] + side * (p + (d[:, 0] > 0)) - x) / d[:, 0]
        out_y = (low[1] + side * (q + (d[:, 1] > 0)) - y) / d[:, 1]
        leave = np.maximum(np.minimum(out_x, out_y), 0) + 1e-7
        over = z + np.minimum(0, leave * d[:, 2]) > highest[q, p]
        step = np.where(over, leave, np.minimum(stride, leave))
        near = np.flatnonzero(~over)
        end = t + step
        below = np.zeros(len(t), bool)
        e = end[near]
        below[near] = origin[2] + e * d[near, 2] < between(
            heights, origin[0] + e * d[near, 0], origin[1] + e * d[near, 1])
        if below.any():
            begins.append(t[below])
            ends.append(end[below])
            rays.append(ray[below])
            ways.append(d[below])
            ray, d, end, stride = (a[~below] for a in (ray, d, end, stride))
        t = end
    if rays:
        begin, end, rays, d = (np.concatenate(a) for a in (begins, ends, rays, ways))
        for _ in range(16):
            middle = 0.5 * (begin + end)
            below = origin[2] + middle * d[:, 2] < between(
                heights, origin[0] + middle * d[:, 0], origin[1] + middle * d[:, 1])
            begin, end = np.where(below, begin, middle), np.where(below, middle, end)
        out[rays] = 0.5 * (begin + end)
    return out


def cast_prism(outline, width, position, turn, origin, directions):
    """Ranges of rays to a bucket's body, a prism along y over an outline (x, z); infinity: misses."""
    o, d = (origin - position) @ turn, directions @ turn
    best = np.full(len(d), np.inf)
    outline = np.asarray(outline, float)
    with np.errstate(divide="ignore", invalid="ignore"):
        for a, b in zip(outline, np.roll(outline, -1, axis=0)):
            e, w = b - a, a - o[[0, 2]]
            cross = d[:, 0] * e[1] - d[:, 2] * e[0]
            t = (w[0] * e[1] - w[1] * e[0]) / cross
            s = (w[0] * d[:, 2] - w[1] * d[:, 0]) / cross
            hit = (t > 0) & (s >= 0) & (s <= 1) & (np.abs(o[1] + t * d[:, 1]) <= width / 2)
            best = np.where(hit, np.minimum(best, t), best)
        for y in (-width / 2, width / 2):
            t = (y - o[1]) / d[:, 1]
            x, z = o[0] + t * d[:, 0], o[2] + t * d[:, 2]
            odd = np.zeros(len(d), bool)
            for a, b in zip(outline, np.roll(outline, -1, axis=0)):
                odd ^= ((a[1] > z) != (b[1] > z)) & (
                    x < (b[0] - a[0]) * (z - a[1]) / (b[1] - a[1] + 1e-300) + a[0])
            best = np.where(odd & (t > 0), np.minimum(best, t), best)
    return best


def quaternion(turn):
    """(x, y, z, w) of a rotation matrix."""
    w, v = np.linalg.eigh(np.array([
        [turn[0, 0] - turn[1, 1] - turn[2, 2], 0, 0, 0],
        [turn[0, 1] + turn[1, 0], turn[1, 1] - turn[0, 0] - turn[2, 2], 0, 0],
        [turn[0, 2] + turn[2, 0], turn[1, 2] + turn[2, 1], turn[2, 2] - turn[0, 0] - turn[1, 1], 0],
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1], np.trace(turn)]]))
    q = v[:, np.argmax(w)]
    return q * (1 if q[3] >= 0 else -1)


def turned(vector):
    """Rotation matrix of a rotation vector."""
    angle = np.linalg.norm(vector)
    if angle == 0:
        return np.eye(3)
    x, y, z = np.asarray(vector) / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)


@dataclasses.dataclass
class Rig:
    """A sensor as it is told to the engine: pose, rays, and the noise of its ranges.

    rays: (rows, columns, 3) unit vectors in its frame. sigma of a range R: constant + squared R^2, m;
    of a stereo camera 0.8 of it is common to patches of pixels.
    """

    name: str
    position: np.ndarray
    turn: np.ndarray
    rays: np.ndarray
    constant: float
    squared: float
    patch: int = 1
    intrinsics: tuple | None = None
    moves: tuple = (0.0, 0.0)   # sigmas of each scan's pose: shift, m, and turn, rad

    def sigma(self, ranges):
        return self.constant + self.squared * ranges**2

    def sensor(self, soilvdb):
        return soilvdb.Sensor(
            name=self.name, position=self.position, rotation=quaternion(self.turn),
            range_sigma=self.constant, range_squared_sigma=self.squared,
            mount_height_sigma=MOUNT_HEIGHT, mount_tilt_sigma=MOUNT_TILT,
            mount_scale_sigma=MOUNT_SCALE, pose_shift_sigma=self.moves[0],
            pose_turn_sigma=self.moves[1])

    def told(self, soilvdb, ranges):
        """What Site.scan() is given, by name, of ranges of all rays, NaN: none."""
        r = ranges.reshape(self.rays.shape[:2])
        given = {"sensor": self.sensor(soilvdb)}
        if self.intrinsics:
            return {**given, "depth": r * self.rays[..., 2], "intrinsics": self.intrinsics}
        return {**given, "points": (r[..., None] * self.rays).reshape(-1, 3)}

    def scan(self, soilvdb, site, ranges):
        site.scan(**self.told(soilvdb, ranges))


def camera(quick=False, position=(0.0, 0.0, 4.0), down=math.radians(42)):
    """A stereo camera of 640 x 480 pixels over 87 degrees; sigma 35 mm at 4 m in patches of 5 px."""
    coarser = 4 if quick else 1
    shape = (480 // coarser, 640 // coarser)
    f = shape[1] / 2 / math.tan(math.radians(87 / 2))
    intrinsics = (f, f, (shape[1] - 1) / 2, (shape[0] - 1) / 2)
    u, v = np.meshgrid((np.arange(shape[1]) - intrinsics[2]) / f,
                       (np.arange(shape[0]) - intrinsics[3]) / f)
    rays = np.stack([u, v, np.ones(shape)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    c, s = math.cos(down), math.sin(down)
    turn = np.array([[0, -s, c], [-1, 0, 0], [0, -c, -s]])   # its x right, y down, z ahead
    return Rig("camera", np.array(position), turn, rays, 0.001, 0.035 / 16, 5, intrinsics)


def lidar(quick=False, position=(0.0, 0.0, 3.2), down=math.radians(35)):
    """32 beams over 45 degrees, 1024 steps a turn, leant forwards; sigma 20 mm."""
    beams, steps = 32, 256 if quick else 1024
    up = np.radians(np.linspace(-22.5, 22.5, beams))[:, None]
    way = 2 * math.pi * np.arange(steps)[None, :] / steps
    rays = np.stack([np.cos(up) * np.cos(way), np.cos(up) * np.sin(way), np.sin(up) + 0 * way], axis=-1)
    return Rig("lidar", np.array(position), turned([0, down, 0]), rays, 0.02, 0.0)


class Scene:
    """A trench whose wall slumped, and a heap, on rough ground, by a seed; and all errors."""

    def __init__(self, seed):
        self.rng = rng = np.random.default_rng(seed)
        x, y = (a for a in np.meshgrid(*posts()))
        self.slope = rng.uniform(-0.04, 0.04, 2)
        self.level = self.slope[0] * x + self.slope[1] * y
        self.natural = (self.level + smooth_field(rng, rng.uniform(0.015, 0.04), rng.uniform(0.7, 1.5))
                        + smooth_field(rng, 0.004, 0.15))
        # The trench: s along it, t across it.
        self.middle = np.array([rng.uniform(4.6, 5.4), rng.uniform(0.0, 0.5)])
        self.yaw, self.half = rng.uniform(-0.25, 0.25), rng.uniform(1.6, 2.1)
        self.depth = rng.uniform(0.6, 0.95)
        s, t = self.along(x, y)
        self.dug = (np.abs(s) <= self.half) & (np.abs(t) <= WIDTH / 2)
        lip = self.level - np.minimum(self.depth, self.half - np.abs(s))
        truth = np.where(self.dug, np.minimum(self.natural, lip + smooth_field(rng, FLOOR, 0.15)),
                         self.natural)
        # A wall that slumped: its soil lies, looser, on the floor.
        side, wide = rng.choice([-1, 1]), rng.uniform(0.2, 0.3)
        deep = rng.uniform(0.5, 0.8) * self.depth
        length, at = rng.uniform(1.2, 1.5), rng.uniform(-0.4, 0.4)
        t = side * t
        taper = np.clip((length / 2 - np.abs(s - at)) / 0.15, 0, 1)
        gone = taper * deep * np.clip(1 - (t - WIDTH / 2) / wide, 0, 1) * (t > WIDTH / 2)
        high = deep * wide / 0.5 * rng.uniform(1.05, 1.3)
        lies = taper * high * np.clip((t - 0.1) / 0.5, 0, 1) * (t <= WIDTH / 2)
        self.slumped = (gone > 0.02) | (lies > 0.02)
        truth = truth - gone + lies
        # A heap, whose repose and volume the engine doesn't know well.
        self.heap = np.array([rng.uniform(6.6, 7.4), rng.uniform(-3.3, -2.9)])
        high, repose = rng.uniform(0.8, 1.1), math.radians(rng.uniform(31, 36))
        self.truth = truth + np.maximum(
            0, high - np.hypot(x - self.heap[0], y - self.heap[1]) * math.tan(repose))
        self.heap_m3 = (math.pi / 3 * high**3 / math.tan(repose) ** 2
                        * (1 + 0.03 * rng.standard_normal()))
        # What is told errs.
        self.lip_error = LIP * rng.standard_normal()
        self.lip_drift = smooth_field(rng, LIP_DRIFT, 3.0)
        self.survey = self.natural + smooth_field(rng, LOCAL, 2.0)
        self.mount = {name: (MOUNT_HEIGHT * rng.standard_normal(),
                             MOUNT_TILT * rng.standard_normal(2), MOUNT_SCALE * rng.standard_normal())
                      for name in ("camera", "lidar")}

    def along(self, x, y):
        """Places along the trench and across it."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return (c * (x - self.middle[0]) + s * (y - self.middle[1]),
                -s * (x - self.middle[0]) + c * (y - self.middle[1]))

    def place(self, s, t=0.0):
        """x, y of a place along and across the trench."""
        c, n = math.cos(self.yaw), math.sin(self.yaw)
        return self.middle[0] + c * s - n * t, self.middle[1] + n * s + c * t

    def rotation(self):
        return (0.0, 0.0, math.sin(self.yaw / 2), math.cos(self.yaw / 2))

    def lip_errors(self, x, y):
        """Told height of the lip less the true, m, at places."""
        return self.lip_error + between(self.lip_drift, np.asarray(x), np.asarray(y))

    def predicted(self, soilvdb, profile, rig):
        """The engine's site: machine 0 dug the trench, machine 1 hovers over it later. The rig watches
        from the start: the engine doesn't know which machine dug before the first scan."""
        ground = soilvdb.raster(self.survey.astype(np.float32), origin=ORIGIN, cell=CELL)
        above = self.slope @ self.heap + 2.5
        site = soilvdb.Site(
            COLUMN, ground, [soilvdb.Machine(soilvdb.Bucket(WIDTH, 1.3), "digger"),
                             soilvdb.Machine(soilvdb.Bucket(WIDTH, 0.9, profile), "loader")],
            soil=soilvdb.Soil(math.radians(35), 0.2),
            pours=[soilvdb.Pour((*self.heap, above), self.heap_m3, (0, 10))])
        site.scan(rig.sensor(soilvdb), np.zeros((0, 3)))
        site.pour(10.0)
        site.come_to_rest()
        s = np.linspace(-self.half, self.half, 2 * math.ceil(self.half / 0.05) + 1)
        x, y = self.place(s)
        level = self.slope[0] * x + self.slope[1] * y
        for share in (0.5, 1.0):
            z = level - share * np.minimum(self.depth, self.half - np.abs(s)) + self.lip_errors(x, y)
            site.place("digger", position=(*self.place(-self.half - 0.4), level[0] + 0.6),
                       rotation=self.rotation())
            site.update_path("digger", positions=np.stack([x, y, z], axis=1),
                             rotations=np.tile(self.rotation(), (len(x), 1)))
            site.update("digger", position=(*self.place(self.half + 0.3), level[-1] + 0.6),
                        rotation=self.rotation())
        for machine in ("digger", "loader"):
            site.place(machine, position=PARKED)
        return site

    def pose(self, rig):
        """Where a rig is in truth: position, rotation matrix, and the share its ranges are too long."""
        height, tilt, scale = self.mount[rig.name]
        return rig.position + [0, 0, height], turned([*tilt, 0]) @ rig.turn, scale


class Frames:
    """What a rig measures of a scene, frame by frame: ranges of its rays, NaN where there is none."""

    def __init__(self, scene, rig, seed, moved=None):
        """moved: shift, m, and rotation vector by which the rig is off its place."""
        self.scene, self.rig, self.rng = scene, rig, np.random.default_rng(seed)
        self.eye, self.turn, self.scale = scene.pose(rig)
        if moved is not None:
            self.eye, self.turn = self.eye + moved[0], turned(moved[1]) @ self.turn
        self.ways = rig.rays.reshape(-1, 3) @ self.turn.T
        self.truth = cast(scene.truth, self.eye, self.ways)
        shape = rig.rays.shape[:2]
        r = self.truth.reshape(shape)
        # At an edge ranges jump. Those of a lidar's beams differ far away on level ground as well, but
        # there they do so by as much on both sides.
        edge = np.zeros(shape, bool)
        with np.errstate(invalid="ignore"):
            edge[1:-1] |= np.abs(np.diff(r, 2, axis=0)) > 0.3
            edge[:, 1:-1] |= np.abs(np.diff(r, 2, axis=1)) > 0.3
        self.edge = edge.ravel() & np.isfinite(self.truth)

    def hits(self):
        """Which of the columns scored a ray meets, without noise."""
        met = np.isfinite(self.truth)
        at = self.eye[:2] + self.truth[met, None] * self.ways[met, :2]
        i = np.round((at - FIRST) / COLUMN).astype(int)
        rows, cols = COLUMNS
        i = i[(i >= 0).all(axis=1) & (i[:, 0] < cols) & (i[:, 1] < rows)]
        hit = np.zeros(COLUMNS, bool)
        hit[i[:, 1], i[:, 0]] = True
        return hit

    def frame(self, flying=True, dust=True, mirrored=False, body=None):
        """Ranges with noise. body: (position, turn, outline, width) of a bucket in view."""
        rng, rig, r = self.rng, self.rig, self.truth.copy()
        if body is not None:
            position, turn, outline, width = body
            r = np.minimum(r, cast_prism(outline, width, position, turn, self.eye, self.ways))
        r[~np.isfinite(r) | (rng.random(len(r)) < NO_RETURN)] = np.nan
        noise = rng.standard_normal(len(r))
        if rig.patch > 1:
            rows, cols = rig.rays.shape[:2]
            patches = rng.standard_normal((rows // rig.patch + 1, cols // rig.patch + 1))
            common = np.repeat(np.repeat(patches, rig.patch, 0), rig.patch, 1)[:rows, :cols]
            noise = 0.8 * common.ravel() + 0.6 * noise
        measured = r * (1 + self.scale) + rig.sigma(r) * noise
        if flying:
            some = self.edge & (rng.random(len(r)) < FLYING)
            measured[some] -= 0.5 * rng.random(some.sum())
        if dust:
            some = rng.random(len(r)) < DUST
            measured[some] *= 0.3 + 0.7 * rng.random(some.sum())
        if mirrored:
            some = rng.random(len(r)) < MIRRORED
            measured[some] *= 1 + rng.random(some.sum())
        return measured

    def points(self, measured):
        """Points (N, 3) in the world, by the pose that is told, and the lengths of their rays (N)."""
        there = np.isfinite(measured)
        ways = self.rig.rays.reshape(-1, 3)[there] @ self.rig.turn.T
        return self.rig.position + measured[there, None] * ways, ways, measured[there]
