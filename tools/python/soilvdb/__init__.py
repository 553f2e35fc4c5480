# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Tracks the shape of the ground and the soil in the bucket while machines dig, carry and dump.

    import soilvdb
    site = soilvdb.Site(0.05, soilvdb.plane(0.0), [soilvdb.Bucket(width=1.2, height=0.9)])
    for position, rotation in poses:
        load_m3 = site.update(0, position=position, rotation=rotation).bucket_m3

World frame: right-handed, metres, radians, seconds, z up. Invalid input raises a ValueError with a
one-line message and leaves the site unchanged.
"""

from typing import Any as _Any

from . import _compiled as _compiled  # first: it names the Python that the rest is for
from ._errors import NoGroundError, StateError
from ._force import Identified, Wrench, identify
from ._run import run
from ._sensors import depth_image, lidar_turn
from ._soilvdb import (
    Bucket,
    CutGeometry,
    Heap,
    Hopper,
    Machine,
    Patch,
    Pour,
    Resistance,
    Sensor,
    Site,
    Soil,
    Survey,
    SurveyedGround,
    Terrain,
    Update,
    Volume,
    __version__,
    height_maps,
    motions,
    plane,
    points,
    raster,
    read_raster,
    resistances,
    snapshot,
    tool,
    update_many,
    write_raster,
)
from .ensemble import Ensemble, Spread, WrenchSpread
from .vector import Steps, VectorSite

__all__ = [
    "Bucket",
    "CutGeometry",
    "Ensemble",
    "Heap",
    "Hopper",
    "Identified",
    "Machine",
    "NoGroundError",
    "Patch",
    "Pour",
    "Resistance",
    "Sensor",
    "Site",
    "Soil",
    "Spread",
    "StateError",
    "Steps",
    "Survey",
    "SurveyedGround",
    "Terrain",
    "Update",
    "VectorSite",
    "Volume",
    "Wrench",
    "WrenchSpread",
    "__version__",
    "depth_image",
    "height_maps",
    "identify",
    "lidar_turn",
    "motions",
    "plane",
    "points",
    "raster",
    "read_raster",
    "resistances",
    "run",
    "snapshot",
    "tool",
    "update_many",
    "write_raster",
]

for _thing in (Bucket, CutGeometry, Heap, Hopper, Identified, Machine, Patch, Pour, Resistance,
               Sensor, Site, Soil, Survey, SurveyedGround, Terrain, Update, Volume, Wrench, depth_image,
               height_maps, identify, lidar_turn, motions, plane, points, raster, read_raster,
               resistances, snapshot, update_many, write_raster):
    _thing.__module__ = "soilvdb"  # where users find it, and pickle


def _unpickle(made_from: _Any, state: bytes, limits: bool) -> Site:
    if len(made_from) == 1:
        site = Site.open(*made_from, limits=limits)
    else:
        voxel_size, terrain, machines, soil, pours, hoppers, near = made_from
        site = Site(voxel_size, terrain, machines, soil=soil, pours=pours, hoppers=hoppers,
                    near=near, limits=limits)
    site.restore(state)
    return site
