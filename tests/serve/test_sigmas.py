# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""What viewers are told of scans: sigmas of the heights that they saw, when they came, and lips."""
import struct

import numpy as np
import pytest
import soilvdb
from live import Server, passes, state_told, until
from test_scan import (DEPTH, EYE, FLAT, INTRINSICS, PARKED, POINTS, PROFILE, SHAPE, VOXEL, message, pit, scan,
                       site)

LEAST_M, TERRAIN_M = 0.003, 0.010  # what a lidar knows at best, and what is known of ground that nobody touched


class Sigmas:
    """The answer to /sigmas, decoded as tools/guide/live.md says."""

    def __init__(self, server, query=""):
        status, self.data = server.get("/sigmas" + query)
        assert status == 200
        west, south, self.cell, nx, ny = struct.unpack_from("<dddII", self.data)
        cells = np.frombuffer(self.data, "<u2", offset=32).reshape(ny, nx)
        self.m = np.where(cells == 65535, np.nan, cells / 1e4)
        x, y = (low + self.cell * (np.arange(n) + 0.5) for low, n in ((west, nx), (south, ny)))
        self.x, self.y = np.meshgrid(x, y)

    @property
    def seen(self):
        return ~np.isnan(self.m)


def test_sigmas_are_those_of_the_columns_that_the_sensor_saw(tmp_path):
    image, _ = pit()
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        assert Sigmas(server).m.size == 0
        scan(server, [message(DEPTH, image.tobytes())])
        told = Sigmas(server)
        assert told.cell == VOXEL
        # What the camera has in view of the level ground, less and more a column.
        reach = [4 * (n / 2) / f for n, f in zip(SHAPE[::-1], INTRINSICS)]
        off = np.maximum(abs(told.x - EYE[0]) - reach[0], abs(told.y - EYE[1]) - reach[1])
        beside = np.maximum(abs(told.x - 0.45), abs(told.y - 0.45)) > 0.5 + VOXEL   # of the pit
        assert np.all(told.seen[(off < -VOXEL) & beside]) and not np.any(told.seen[off > VOXEL])
        natural = told.m[(off < -VOXEL) & beside]
        assert LEAST_M <= natural.min() and np.median(natural) < TERRAIN_M
        engine = soilvdb.Site(VOXEL, soilvdb.plane(0.0), [soilvdb.Bucket(1.2, 0.9, PROFILE), soilvdb.Bucket(1.0, 0.6)],
                              soil=soilvdb.Soil(repose_angle=0.6, swell=0.2))
        engine.scan(soilvdb.Sensor(name="mast", position=EYE, rotation=(1, 0, 0, 0), range_sigma=0.005), depth=image,
                    intrinsics=INTRINSICS)
        engine.apply_scans()
        _, sigma = engine.heights(np.stack([told.x, told.y], axis=-1)[told.seen], sigma=True)
        assert np.abs(told.m[told.seen] - sigma).max() <= 0.51e-4
        # Ground that is dug is no longer as it was seen, until it is seen again.
        server.feed(passes("digger", 0.0, 0.2, 20))
        now = Sigmas(server)
        dug = (now.x > 1.2) & (now.x < 1.8) & (abs(now.y) < 0.5)
        assert dug.sum() >= 5 * 9 and not np.any(now.seen[dug])
        far = now.y > 2
        assert np.array_equal(now.m[far], told.m[told.y > 2], equal_nan=True) and np.any(now.seen[far])


def test_scans_and_lips_are_told_at_each_time_and_after_a_restart(tmp_path):
    image, _ = pit()
    path, out = site(tmp_path), tmp_path / "out"
    with Server(path, "--out", out, cwd=tmp_path) as server:
        assert all("error" not in answer for answer in server.feed([{**PARKED, "time": 0.5}]))
        before = state_told(server)
        assert before["scans"] == [] and before["scanned_s"] is None
        assert [machine["lip_error_m"] for machine in before["machines"]] == [None, None]
        scan(server, [message(POINTS)])  # so that the machines are told apart
        assert state_told(server)["scans"] == [], "a scan without points tells of nothing"
        server.feed([*({**state, "time": 0.6 + state["time"]} for state in passes("digger", 0.0, 0.2, 20)), PARKED])
        flying = {**POINTS, "sensor": "flying", "position": [0, 0, 3], "rotation": [1, 0, 0, 0]}
        scan(server, [message({**DEPTH, "time": 0.25}, image.tobytes())])
        one, two = scan(server, [message({**DEPTH, "time": 1.5}, image.tobytes()),
                                 message({**flying}, np.array([[0, 0, 3]], "<f4").tobytes())])
        assert "error" not in one
        told = state_told(server)
        assert [(of["sensor"], of["time_s"], of["count"]) for of in told["scans"]] == \
            [("flying", PARKED["time"], 1), ("mast", 1.5, 2)]
        assert all(0 <= of["heard_s_ago"] < 60 for of in told["scans"])
        ago = told["scans"][1]["heard_s_ago"]
        until(lambda: state_told(server)["scans"][1]["heard_s_ago"] > ago)
        assert told["scanned_s"] == PARKED["time"]
        lips = {machine["name"]: machine["lip_error_m"] for machine in told["machines"]}
        assert lips == {name: {"mean": mean, "sigma": sigma} for name, (mean, sigma) in two["lip_error"].items()}
        assert lips["digger"]["sigma"] < 0.02 == lips["plate"]["sigma"]
        now = Sigmas(server)
        server.feed([{**PARKED, "time": 2.0}])
        assert Sigmas(server, "?time=1.5").data == now.data
        assert Sigmas(server, "?time=0.55").m.size == 0
        server.kill()
    for arguments in ((path, "--out", out), (out,)):  # goes on with it, and looks at it
        with Server(*arguments, cwd=tmp_path) as server:
            again = state_told(server)
            assert again["scans"] == [] and again["scanned_s"] == PARKED["time"]
            assert {machine["name"]: machine["lip_error_m"] for machine in again["machines"]} == lips
            assert Sigmas(server).data == now.data


@pytest.mark.parametrize("far", [(120.0, 120.0), (500.0, 0.0)])  # more than a million cells, and a long row
def test_places_far_apart_have_larger_cells(tmp_path, far):
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        side = VOXEL * (np.arange(16) - 7.5)
        x, y = np.meshgrid(side + 0.45, side + 0.45)
        for at in ((0.0, 0.0), far):
            points = np.stack([x + at[0], y + at[1], 0 * x], axis=-1).reshape(-1, 3)
            answer, = scan(server, [message({"sensor": "flying", "format": "float64_xyz", "frame": "world",
                                             "position": [at[0], at[1], 5], "rotation": [1, 0, 0, 0]}, points.tobytes())])
            assert answer["rays"]["used"] > 200
        told = Sigmas(server)
        assert told.cell == 2 * VOXEL and told.m.size <= 1 << 20 and max(told.m.shape) <= 4096
        row = told.seen[np.argmin(abs(told.y[:, 0] - 0.45))]
        ends = [row[np.argmin(abs(told.x[0] - x))] for x in (-0.55, -0.35, 1.05, 1.25)]
        assert ends == [False, True, True, False], "columns -3 to 12, by the second of two"
        near = np.hypot(told.x - 0.45, told.y - 0.45) < 0.6
        there = np.hypot(told.x - 0.45 - far[0], told.y - 0.45 - far[1]) < 0.6
        assert near.sum() > 20 and np.all(told.seen[near]) and np.all(told.seen[there])
        outside = np.minimum(*(np.maximum(abs(told.x - 0.45 - a), abs(told.y - 0.45 - b)) for a, b in ((0, 0), far)))
        assert not np.any(told.seen[outside > 0.8 + VOXEL]) and told.seen.sum() <= 2 * 9 * 9


def test_what_is_no_time_is_refused(tmp_path):
    with Server(site(tmp_path), "--out", tmp_path / "out", cwd=tmp_path) as server:
        status, body = server.get("/sigmas?time=soon")
        assert status == 400 and b"time" in body
        status, body = server.get("/sigmas?against=1")
        assert status == 400 and b"against" in body
