# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Simulated depth cameras and lidars, to try scans without a sensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _soilvdb

if TYPE_CHECKING:
    from ._soilvdb import Sensor, Site

Floats = npt.NDArray[np.float64]

_PATCH = 5              # pixels of a stereo camera that are matched as one
_COMMON, _OWN = 0.8, 0.6  # shares of its sigma that a patch has in common, and a pixel has alone
_FIELD = math.radians(45)  # of a lidar, between its lowest and highest beam


def depth_image(site: Site, sensor: Sensor, shape: tuple[int, int], intrinsics: Sequence[float],
                seed: int | None = None) -> Floats:
    """The depth image (H, W) that a sensor would take of a site's ground, m, NaN where no ground is.

    shape: (H, W), rows and columns of pixels. intrinsics: (fx, fy, cx, cy) in pixels, of pixel
    centres: pixel (0, 0) is at (0, 0). The sensor's frame is optical: z forward, x right, y down;
    depth is along z, not along the ray. seed: of the sensor's noise; None: without noise. The sigma
    of a ray is range_sigma + range_squared_sigma * R^2. If range_squared_sigma is more than 0 the
    sensor is a stereo camera, and patches of 5 x 5 pixels have 0.8 of their sigma in common. The
    mount's errors are not simulated: for these, give Site.scan() a sensor whose pose differs.
    Raises ValueError for a bad shape or intrinsics, and for a sensor below the ground.

        camera = soilvdb.Sensor(position=(0, 0, 4), rotation=(1, 0, 0, 0), range_sigma=0.01)
        intrinsics = (300, 300, 159.5, 119.5)
        site.scan(camera, depth=soilvdb.depth_image(site, camera, (240, 320), intrinsics, seed=1),
                  intrinsics=intrinsics)
    """
    _check(site, sensor, seed)
    rows, columns = _whole("shape", shape, 2)
    try:
        fx, fy, cx, cy = (float(value) for value in intrinsics)
    except (TypeError, ValueError):
        raise ValueError(f"intrinsics is {_shown(intrinsics)}; it must be (fx, fy, cx, cy), in pixels"
                         ) from None
    if not (fx > 0 and fy > 0 and all(map(math.isfinite, (fx, fy, cx, cy)))):
        raise ValueError(f"intrinsics is ({fx:g}, {fy:g}, {cx:g}, {cy:g}); all must be finite, and "
                         "fx and fy more than 0")
    u, v = np.meshgrid((np.arange(columns) - cx) / fx, (np.arange(rows) - cy) / fy)
    rays = np.stack([u, v, np.ones((rows, columns))], axis=-1)
    length = np.sqrt((rays * rays).sum(axis=-1))
    ranges = _ranges(site, sensor, rays)
    if seed is not None:
        rng = np.random.default_rng(seed)
        noise = rng.standard_normal((rows, columns))
        if sensor.range_squared_sigma > 0:
            patches = rng.standard_normal((-(-rows // _PATCH), -(-columns // _PATCH)))
            common = patches.repeat(_PATCH, axis=0).repeat(_PATCH, axis=1)[:rows, :columns]
            noise = _COMMON * common + _OWN * noise
        ranges = _noisy(sensor, ranges, noise)
    return np.asarray(ranges / length)


def lidar_turn(site: Site, sensor: Sensor, beams: int | Sequence[float] = 32, steps: int = 1024,
               seed: int | None = None) -> Floats:
    """Points (beams * steps, 3) of one turn of a lidar over a site's ground, m, in the sensor's frame,
    beam by beam; NaN where a ray meets no ground.

    beams: number of beams, evenly over 45 degrees, or their angles above the sensor's x-y plane,
    rad, as an array. steps: rays a turn; the first goes along x, the others follow anticlockwise
    about z. seed: of the sensor's noise; None: without noise. The sigma of a ray is range_sigma +
    range_squared_sigma * R^2, and rays err independently. The mount's errors are not simulated: for
    these, give Site.scan() a sensor whose pose differs. Raises ValueError for bad beams or steps,
    and for a sensor below the ground.

        lidar = soilvdb.Sensor(position=(0, 0, 3), range_sigma=0.02)
        site.scan(lidar, soilvdb.lidar_turn(site, lidar, 32, 1024, seed=1))
    """
    _check(site, sensor, seed)
    if isinstance(beams, (int, np.integer)) and not isinstance(beams, bool):
        (count,) = _whole("beams", (beams,), 1)
        angles = np.linspace(-_FIELD / 2, _FIELD / 2, count) if count > 1 else np.zeros(1)
    else:
        try:
            angles = np.asarray(beams, float)
        except (TypeError, ValueError):
            angles = np.zeros(0)
        if angles.ndim != 1 or not len(angles) or not (np.abs(angles) <= math.pi / 2).all():
            raise ValueError("beams must be a number of beams, or an array (N,) of their angles, at "
                             "most pi / 2 rad")
    (count,) = _whole("steps", (steps,), 1)
    way = 2 * math.pi * np.arange(count) / count
    up = angles[:, None]
    rays = np.stack([np.cos(up) * np.cos(way), np.cos(up) * np.sin(way), np.sin(up) + 0 * way], axis=-1)
    ranges = _ranges(site, sensor, rays)
    if seed is not None:
        noise = np.random.default_rng(seed).standard_normal(ranges.shape)
        ranges = _noisy(sensor, ranges, noise)
    return np.asarray(ranges[..., None] * rays).reshape(-1, 3)


def _check(site: Any, sensor: Any, seed: Any) -> None:
    for name, value, kind in (("site", site, _soilvdb.Site), ("sensor", sensor, _soilvdb.Sensor)):
        if not isinstance(value, kind):
            raise TypeError(f"{name} must be soilvdb.{kind.__name__}, not {type(value).__name__}")
    whole = isinstance(seed, (int, np.integer)) and not isinstance(seed, bool)
    if seed is not None and not (whole and seed >= 0):
        raise ValueError(f"seed is {_shown(seed)}; it must be a whole number, 0 or more, or None")


def _shown(given: Any) -> str:
    """For a message of one line."""
    text = repr(given)
    return text if "\n" not in text and len(text) <= 80 else type(given).__name__


def _whole(name: str, given: Any, count: int) -> tuple[int, ...]:
    """Numbers of rays, 1 or more."""
    try:
        values = tuple(given)
    except TypeError:
        values = ()
    if len(values) != count or not all(
            isinstance(value, (int, np.integer)) and not isinstance(value, bool) and value > 0
            for value in values):
        wanted = "(H, W), whole numbers" if count == 2 else "a whole number"
        shown = _shown(given if count == 2 else given[0])
        raise ValueError(f"{name} is {shown}; it must be {wanted}, 1 or more")
    return tuple(int(value) for value in values)


def _ranges(site: Site, sensor: Sensor, rays: Floats) -> Floats:
    """Ranges of rays (..., 3) in the sensor's frame, m, NaN where no ground is."""
    x, y, z, w = np.asarray(sensor.rotation, float) / np.linalg.norm(sensor.rotation)
    world_from_sensor = np.array(
        [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
         [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
         [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    ranges = site.cast(np.asarray(sensor.position, float), rays @ world_from_sensor.T)
    if (ranges == 0).any():
        raise ValueError("the sensor is below the ground")
    return np.where(np.isfinite(ranges), ranges, np.nan)


def _noisy(sensor: Sensor, ranges: Floats, noise: Floats) -> Floats:
    sigma = sensor.range_sigma + sensor.range_squared_sigma * ranges * ranges
    return np.asarray(ranges + sigma * noise)
