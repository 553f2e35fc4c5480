# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""python3 -m soilvdb.fleet uncertainty: against closed forms, digs that are known, and itself."""

import contextlib
import csv
import dataclasses
import json
import math
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from closed_forms import (DEPTH, LENGTH, WIDTH, correlated_terrain, covered, drifting_height,
                          flat_pass, repeated_passes, scene, systematic_terrain,
                          uncorrelated_terrain, white_height, wide_bucket, write_pass)
from processes import FLEET, LONG, Processes, call, wait_until

import soilvdb
from soilvdb import noise as noises
from soilvdb.fleet import InputError
from soilvdb.fleet.cycles import Cycle, cycles_of, nearest_cycles
from soilvdb.fleet.study import Scene, Study, scene_of
from soilvdb.fleet.uncertainty import _shares, first_order, spread

NOISE = "position: {bias: [0, 0, 0.01], white: 0.001}\nbucket: {width: 0.02}\n"


@pytest.fixture(name="uncertainty")
def _uncertainty(fleet):
    return lambda scenario, noise, out, *options: fleet("uncertainty", scenario, "--noise", noise,
                                                        "--out", out, *options)


@pytest.mark.parametrize("case, sigma, draws, within", [
    (flat_pass, 0.01, 300, 0.05), (systematic_terrain, 0.01, 100, 0.05),
    (uncorrelated_terrain, 0.02, 100, 0.1), (correlated_terrain, 0.02, 100, 0.1),
    (drifting_height, 0.01, 300, 0.1), (white_height, 0.005, 300, 0.1),
    (wide_bucket, 0.01, 200, 0.05)])
def test_sigmas_are_those_of_closed_forms(tmp_path, case, sigma, draws, within):
    found = case(tmp_path, sigma, draws if LONG else draws // 4)
    assert found.within(within), found


def test_a_constant_error_cancels_but_for_the_first_pass(tmp_path):
    of_passes = repeated_passes(tmp_path, 0.01, 60 if LONG else 30)
    assert 0.7 < of_passes[0] < 1.3
    assert max(of_passes[1:]) < 0.02


def test_true_loads_lie_within_the_band(tmp_path):
    assert 0.7 <= covered(tmp_path, 24 if LONG else 6, 60) <= 1.0  # 90 % of them would; see tools/bench fleet


def test_what_is_written(tmp_path, uncertainty):
    scenario = write_pass(tmp_path)
    (tmp_path / "noise.yaml").write_text(NOISE)
    done = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws", 60)
    assert (done.returncode, done.stderr) == (0, "")
    report = json.loads((tmp_path / "out/uncertainty.json").read_text())
    assert report["draws"] == 60 and report["sources"] == ["position.bias", "position.white",
                                                           "bucket.width"]
    machine = report["machines"][0]
    assert machine["name"] == "digger"
    with open(tmp_path / "out/draws.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["draw"] for row in rows] == [str(i) for i in range(60)]
    for key in ("bucket_m3", "cut_m3"):
        values = np.array([float(row[key]) for row in rows])
        figure = machine[key]
        assert figure["mean"] == pytest.approx(values.mean(), rel=1e-12)
        assert figure["sigma"] == pytest.approx(values.std(ddof=1), rel=1e-9)
        assert [figure["p05"], figure["p95"]] == pytest.approx(np.percentile(values, (5, 95)))
        assert figure["recorded"] == pytest.approx(WIDTH * LENGTH * DEPTH, rel=1e-3)
    right = math.hypot(WIDTH * LENGTH * 0.01, 0.02 * LENGTH * DEPTH)
    assert machine["cut_m3"]["sigma"] == pytest.approx(right, rel=0.05 + 3 / math.sqrt(120))
    assert report["cut_m3"]["sigma"] == machine["cut_m3"]["sigma"]
    heights, first, spacing, _ = soilvdb.read_raster(tmp_path / "out/height_sigma.tif")

    def sigma_at(x, y):
        return heights[round((y - first[1]) / spacing[1]), round((x - first[0]) / spacing[0])]

    assert sigma_at(1.2, 0.0) == pytest.approx(0.01, rel=0.3)
    assert sigma_at(1.2, 0.9) == 0 and sigma_at(-0.3, 0.0) == 0
    assert (tmp_path / "out/load.png").read_bytes().startswith(b"\x89PNG")


def test_the_same_seed_gives_the_same_bytes_whoever_draws(tmp_path, uncertainty):
    scenario = write_pass(tmp_path, rows=200)
    (tmp_path / "noise.yaml").write_text(NOISE + "terrain: {white: 0.01, cell: 0.5}\n")
    options = ("--draws", 20, "--seed", 7)
    uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "one", *options)
    with Processes(tmp_path, hosts=(1, 1)) as cluster:
        process = subprocess.Popen([*FLEET, "uncertainty", scenario, "--noise",
                                    tmp_path / "noise.yaml", "--out", tmp_path / "two",
                                    *map(str, options), "--scheduler", cluster.address],
                                   stdout=subprocess.DEVNULL)
        parts = tmp_path / "two/draws.part"
        for done in range(1, 9 if LONG else 3):
            wait_until(lambda want=done: process.poll() is not None
                       or parts.is_dir() and len(list(parts.iterdir())) > want)
            cluster.workers[0].kill()
        assert process.wait(timeout=300) == 0
    uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "other", "--draws", 20, "--seed", 8)
    for name in ("uncertainty.json", "draws.csv", "height_sigma.tif", "load.png"):
        one, two, other = ((tmp_path / out / name).read_bytes() for out in ("one", "two", "other"))
        assert one == two, name
        assert one != other, name


def test_sigmas_of_nothing_leave_what_was_recorded(tmp_path, uncertainty):
    scenario = write_pass(tmp_path, dump=True)
    (tmp_path / "noise.yaml").write_text("position: {bias: 0, white: 0}\nbucket: {width: 0}\n")
    said = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws", 3)
    report = json.loads((tmp_path / "out/uncertainty.json").read_text())
    machine = report["machines"][0]
    for figure in (machine["cut_m3"], report["cut_m3"], machine["cycles"][0]["load_m3"]):
        assert figure["mean"] == figure["p05"] == figure["p95"] == figure["recorded"] > 0
        assert figure["sigma"] == 0
    assert f"digger: load 1           {machine['cycles'][0]['load_m3']['mean']:.4g} +- 0 m3" in said.stdout


def test_a_study_that_was_killed_goes_on(tmp_path, uncertainty, shared):
    scenario = write_pass(tmp_path, rows=2000 if LONG else 1000)
    (tmp_path / "noise.yaml").write_text("position: {bias: 0.01, white: 0.001}\n")
    options = ("--draws", 100 if LONG else 30)
    uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "whole", *options)
    parts = tmp_path / "out/draws.part"
    command = [*FLEET, "uncertainty", scenario, "--noise", tmp_path / "noise.yaml", "--out",
               tmp_path / "out", *map(str, options), "--scheduler", shared]
    process = subprocess.Popen(command)
    wait_until(lambda: parts.is_dir() and len(list(parts.iterdir())) > 3)
    process.kill()
    process.wait()
    assert not (tmp_path / "out/uncertainty.json").exists()
    before = {part: part.stat().st_mtime_ns for part in parts.iterdir() if part.name != "next"}
    again = subprocess.Popen(command)
    wait_until(lambda: len(list(parts.iterdir())) > len(before) + 2)
    assert before == {part: part.stat().st_mtime_ns for part in before}
    assert again.wait() == 0
    for name in ("uncertainty.json", "draws.csv", "height_sigma.tif"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    assert not parts.exists()


def test_sobol_indices_are_the_shares_of_variances(tmp_path, uncertainty):
    """Of the cut of a flat pass: of its height's variance and its width's."""
    height, width = 0.01, 0.03
    scenario = write_pass(tmp_path)
    (tmp_path / "noise.yaml").write_text(
        f"position: {{bias: [0, 0, {height}]}}\nbucket: {{width: {width}}}\n")
    done = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws",
                       draws := 500 if LONG else 125)
    assert done.returncode == 0
    variances = {"position.bias": (WIDTH * LENGTH * height)**2,
                 "bucket.width": (width * LENGTH * DEPTH)**2}
    report = json.loads((tmp_path / "out/uncertainty.json").read_text())
    found = report["machines"][0]["cut_m3"]["sobol"]
    assert set(found) == set(variances)
    for source, variance in variances.items():
        share = variance / sum(variances.values())
        error = found[source]["error"]
        assert found[source]["first_order"] == pytest.approx(share, abs=3 * error), source
        assert 0 < error < 0.06 * math.sqrt(500 / draws)
    assert list(found) == ["position.bias", "bucket.width"]


def test_first_order_of_a_function_that_is_known():
    """The g-function's first terms: x1 + 0.5 x2 + 2 x1 x2, by its variances."""
    random = np.random.default_rng(5)
    x, y, z = random.standard_normal((3, 40_000))

    def value(a, b):
        return a + 0.5 * b + 2 * a * b

    index, error = first_order(value(x, y), value(x, z))
    assert index == pytest.approx(1 / 5.25, abs=4 * error)
    some = [first_order(value(x[i:i + 400], y[i:i + 400]), value(x[i:i + 400], z[i:i + 400]))
            for i in range(0, 40_000, 400)]
    found = np.array(some)
    assert found[:, 1].mean() == pytest.approx(found[:, 0].std(ddof=1), rel=0.25)


def test_an_error_of_the_base_is_the_base_being_elsewhere(tmp_path):
    """A machine with joints dug from a base that errs, and from one that the scenario has there."""
    urdf = """<robot name="r"><link name="root"/><link name="arm"/><link name="bucket"/>
<joint name="crowd" type="prismatic"><parent link="root"/><child link="arm"/>
<origin xyz="0 0 -0.2"/><axis xyz="1 0 0"/><limit lower="0" upper="5" effort="0" velocity="2"/></joint>
<joint name="tip" type="revolute"><parent link="arm"/><child link="bucket"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="0" velocity="2"/></joint></robot>"""
    (tmp_path / "arm.urdf").write_text(urdf)
    (tmp_path / "arm.csv").write_text("time,crowd,tip\n" + "".join(
        f"{t / 10},{1 + 2 * t / 50},{0.2 - 0.2 * t / 50}\n" for t in range(51)))

    def scenario(name, base):
        (tmp_path / f"{name}.yaml").write_text(
            "soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0.0}}\nmachines:\n"
            "  - {name: digger, bucket: {width: 1.0, height: 0.6}, motion: arm.csv, urdf: arm.urdf, "
            f"base: {base}, lip: {{link: bucket, xyz: [0, 0, 0], rpy: [0, 0, 0]}}}}\n")
        return tmp_path / f"{name}.yaml"

    sigma = {"position": {"bias": [0.05, 0.05, 0.05]}, "rotation": {"bias": [0, 0, 0.1]},
             "joints": {"crowd": {"bias": 0.05}}}
    (tmp_path / "arm.urdf").write_text(urdf.replace("</robot>", "<gazebo:camera/></robot>"))
    with pytest.raises(InputError, match="arm.urdf: isn't well-formed XML: unbound prefix"):
        scene(scenario("noisy", "{xyz: [0, 0, 0]}"), sigma)
    (tmp_path / "arm.urdf").write_text(urdf)
    noisy = scene(scenario("noisy", "{xyz: [10, 20, 0], rpy: [0, 0, 0.7]}"), sigma)
    draw = noisy.study.noise.draw(3, 0)
    times = noisy.motions["digger"]["times"]
    position, rotation = (error[0] for error in draw.base("digger", times))
    crowd = draw.joints("digger", times, ["crowd", "tip"])
    assert np.ptp(crowd, axis=0).max() == 0 and crowd[0, 0] != 0 and crowd[0, 1] == 0
    moved = soilvdb.Site.open(scenario("moved", "{xyz: [%r, %r, %r], rpy: [0, 0, %r]}" % (
        *(np.array([10, 20, 0]) + position).tolist(), 0.7 + float(rotation[2]))))
    right = moved.update_path("digger", times=times, joints=noisy.motions["digger"]["joints"] + crowd)
    found = noisy.dig(draw)
    assert right["bucket_m3"][-1] > 0.2
    assert found.load_m3["digger"] == pytest.approx(right["bucket_m3"], abs=1e-5)
    assert abs(found.load_m3["digger"][-1] - noisy.dig(None).load_m3["digger"][-1]) > 1e-3


def test_an_error_of_the_base_of_a_machine_that_drives_is_added_to_its_rows(tmp_path):
    (tmp_path / "arm.urdf").write_text(
        '<robot name="r"><link name="root"/><link name="bucket"/><joint name="tip" type="revolute">'
        '<parent link="root"/><child link="bucket"/><origin xyz="2 0 -0.2"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" effort="0" velocity="2"/></joint></robot>')
    (tmp_path / "arm.csv").write_text("time,tip,base_x,base_y,base_z,base_yaw\n" + "".join(
        f"{t / 10},{0.2 - 0.2 * t / 50},{10 + 2 * t / 50},20,0,{0.3 - t / 200}\n" for t in range(51)))
    path = tmp_path / "drives.yaml"
    path.write_text("soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0.0}}\nmachines:\n"
                    "  - {name: digger, bucket: {width: 1.0, height: 0.6}, motion: arm.csv, "
                    "urdf: arm.urdf, lip: {link: bucket}}\n")
    drives = scene(path, {"position": {"bias": [0.05, 0.05, 0.05], "white": 0.001},
                          "rotation": {"bias": [0, 0, 0.1]}})
    draw = drives.study.noise.draw(3, 0)
    rows = drives.motions["digger"]
    position, rotation = draw.base("digger", rows["times"])
    yaw = 0.3 - np.arange(51) / 200 + rotation[:, 2]
    zero = np.zeros(51)
    base = (rows["base"][0] + position,
            np.stack([zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1))
    site = soilvdb.Site.open(path, limits=False)
    right = site.update_path("digger", times=rows["times"], joints=rows["joints"], base=base)
    found = drives.dig(draw)
    assert right["bucket_m3"][-1] > 0.2
    assert found.load_m3["digger"] == pytest.approx(right["bucket_m3"], abs=1e-5)
    assert abs(found.load_m3["digger"][-1] - drives.dig(None).load_m3["digger"][-1]) > 1e-3


def test_machines_dig_in_the_order_of_a_run(tmp_path):
    """Two that work in one place, in soil that moves, brought to rest: the run's figures."""
    for name, y in (("a", 0.0), ("b", 0.5)):
        (tmp_path / f"{name}.csv").write_text("time,x,y,z,pitch\n" + "".join(
            f"{t / 7 if name == 'a' else 0.3 + t / 5},{2 * t / 30},{y},{-0.2},0\n"
            for t in range(31)) + f"20,2,{y},1.5,1.2\n")
    bucket = ("{width: 0.8, height: 0.6, dump_angle: 0.9, "
              "profile: [[0, 0], [-0.5, 0.1], [-0.5, 0.6], [0, 0.6]]}")
    (tmp_path / "two.yaml").write_text(
        "soilvdb: 1\nvoxel_size: 0.05\nterrain: {plane: {z: 0.0}}\n"
        "soil: {repose_angle: 0.6, swell: 0.2}\npours:\n"
        "  - {name: truck, at: [4, 0, 2], time: [15, 25], volume: 0.3}\nmachines:\n"
        + "".join(f"  - {{name: {name}, bucket: {bucket}, motion: {name}.csv}}\n" for name in "ab"))
    summary = soilvdb.run(tmp_path / "two.yaml", tmp_path / "out")
    dug = scene(tmp_path / "two.yaml", {"position": {"bias": 0.01}}).dig(None)
    assert f"{dug.site.ground_hash():016x}" == summary["state_hash"]
    assert dug.fill_m3 == pytest.approx(summary["volume_m3"]["fill"], abs=1e-9)
    for machine in summary["machines"]:
        assert dug.cut_m3[machine["name"]][-1] == pytest.approx(machine["cut_m3"], abs=1e-9)
    noisy = scene(tmp_path / "two.yaml", {"soil": {"repose": 0.05, "swell": 0.05}})
    fills = {noisy.dig(noisy.study.noise.draw(1, i)).fill_m3 for i in range(4)}
    assert len(fills) == 4


def test_cycles_end_where_a_bucket_loses_most_of_its_load():
    load = np.array([0, .2, .8, .8, .7, .3, 0, 0, .05, .5, .9, 0, .4])
    cut = np.cumsum([0, .2, .6, 0, 0, 0, 0, 0, .05, .45, .4, 0, .4])
    cycles = cycles_of(load, cut, np.arange(13.0))
    assert [(c.begin_s, c.end_s, c.load_m3) for c in cycles] == [(0, 5, .8), (5, 11, .9)]
    assert [c.cut_m3 for c in cycles] == pytest.approx([.8, .9])
    # What stays in it and moves isn't another load.
    wobble = np.array([0, .9, .2, .32, .1, 0])
    assert [c.load_m3 for c in cycles_of(wobble, np.zeros(6), np.arange(6.0))] == [.9]
    assert not cycles_of(np.zeros(3), np.zeros(3), np.arange(3.0))
    late = [Cycle(0, 6, .7, .7), Cycle(6, 30, .2, .2)]
    assert nearest_cycles(cycles, late)[0] == (.7, .7)
    assert nearest_cycles(cycles, late)[1] == (.2, .2)
    missing = nearest_cycles(cycles, [Cycle(0, 10.5, 1.0, 1.0)])
    assert math.isnan(missing[0][0]) and missing[1] == (1.0, 1.0)
    both = nearest_cycles(cycles[1:], [Cycle(0, 5, .8, .8), Cycle(5, 11.2, .9, .9)])
    assert both == [(.9, .9)]


def test_spread_leaves_out_what_is_not_there():
    assert spread([1.0, math.nan, 3.0]) == pytest.approx(
        {"mean": 2.0, "sigma": math.sqrt(2), "p05": 1.1, "p95": 2.9})
    assert math.isnan(spread([1.0])["sigma"])


@pytest.mark.parametrize("text, why", [
    ("postion: {bias: 1}", "noise.yaml:1: postion isn't known; did you mean 'position'?"),
    ("position:\n  bias: -1", "noise.yaml:2: position.bias is -1; it must be a number from 0 to 10"),
    ("position: {drift: {sigma: 1}}", "noise.yaml:1: position.drift has no tau; sigma and tau are"),
    ("position: {bias: [1, 2]}", "noise.yaml:1: position.bias has 2 numbers; it must have one, or one"),
    ("rotation: 3", "noise.yaml:1: rotation is 3; it must be a mapping of bias, drift, white"),
    ("joints: {bias: 0.01}", "noise.yaml: joints: no machine has any; leave them out"),
    ("joints: {boom: {bias: 0.01}}", "noise.yaml: joints.boom: no machine has that joint"),
    ("bucket: {width: 0.5}", "noise.yaml: bucket.width is 0.5, which is more than a fifth"),
    ("soil: {repose: 0.1}", "noise.yaml: soil: doesn't move in the scenario; leave it out"),
    ("terrain: {white: 0.1, cell: 0.001}", "noise.yaml: terrain.cell: takes 30"),
    ("terrain: {correlated: {sigma: 0.1, length: 0.01}}", "noise.yaml: terrain.correlated.length: ta"),
    ("terrain: {cell: 2, correlated: {sigma: 0.1, length: 1}}", "noise.yaml: terrain.cell is 2; it"),
    ("terrain: {white: 0.1}", "noise.yaml: terrain.white: a plane has no heights"),
    ("position: {bias: .nan}", "noise.yaml:1: position.bias is nan; it must be a number from 0 to 10"),
    ("position: [", "noise.yaml:1: is not valid YAML:"),
    ("", "noise.yaml: is empty; an example is position: {bias: 0.01}"),
    ("a: 1\na: 2", "noise.yaml:2: 'a' is there twice; leave one out"),
    ("position:\n  bias: [0, 0, -1e-2]", "noise.yaml:2: position.bias is -0.01; it must be a number"),
    ("position: {bias: 2020-13-45}", "noise.yaml:1: position.bias is '2020-13-45'; it must be"),
    ("position: {bias: '0.1'}", "noise.yaml:1: position.bias is '0.1'; it must be a number"),
    ("position: &p\n  bias: *p", "noise.yaml: is nested too deeply"),
    ("? [a]\n: 1", "noise.yaml:1: a key is not a word; keys are position, bias"),
    ("joints: {bais: 0.1}", "noise.yaml:1: joints.bais isn't known; did you mean 'bias'?"),
    ("joints: {drif: {sigma: 1, tau: 2}}", "noise.yaml:1: joints.drif isn't known; did you mean 'dr"),
])
def test_wrong_noise_is_told_in_one_line(tmp_path, text, why, capsys):
    from soilvdb.fleet.__main__ import main

    scenario = write_pass(tmp_path)
    (tmp_path / "noise.yaml").write_text(text)
    assert main(["uncertainty", str(scenario), "--noise", str(tmp_path / "noise.yaml"), "--draws",
                 "10", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"soilvdb: {tmp_path}/{why}") and said.count("\n") == 1, said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("shares, told", [
    ({"lip": (1.0, 0.0)}, "; of lip 100 %"),
    ({"lip": (0.7, 0.05), "width": (0.3, 0.05)}, "; of lip 60..80 %, width 20..40 %"),
    ({"lip": (0.95, 0.1), "width": (0.3, 0.15)}, "; of lip 75..100 %"),  # width: 1 % or less may be all
    ({"lip": (0.3, 0.15), "width": (0.2, 0.15)}, "; more draws would tell of what"),
    ({"a": (0.4, 0.01), "b": (0.3, 0.01), "c": (0.2, 0.01), "d": (0.1, 0.01)}, "; of a 38..42 %, b 28..32 %, c 18..22 %"),
    ({}, "")])
def test_shares_are_told_as_well_as_they_are_known(shares, told):
    sobol = {name: {"first_order": share, "error": error} for name, (share, error) in shares.items()}
    assert _shares(sobol) == told


def test_wrong_command_lines_and_scenarios(tmp_path, capsys):
    from soilvdb.fleet.__main__ import main

    scenario = write_pass(tmp_path)
    (tmp_path / "noise.yaml").write_text(NOISE)
    right = ["uncertainty", str(scenario), "--noise", str(tmp_path / "noise.yaml"), "--draws", "10",
             "--out", str(tmp_path / "out")]
    for at, wrong, why in ((1, "none.yaml", "none.yaml"), (3, "none.yaml", "none.yaml: No such"),
                           (5, "1", "'1' is not a whole number from 2 to"), (5, "x", "'x' is not a whole"),
                           (7, str(tmp_path / "noise.yaml"), "can't be made a folder: Not a dir")):
        command = [wrong if i == at else each for i, each in enumerate(right)]
        assert main(command) == 2
        said = capsys.readouterr().err
        assert why in said and said.count("\n") == 1, said
    with pytest.raises(InputError):
        scene(tmp_path / "pass.yaml", {"joints": {"x": {"bias": 0.1}}})
    with pytest.raises(noises.NoiseError, match="position.white is 'x'"):
        noises.of({"position": {"white": "x"}})


def test_buckets_and_planes_of_draws(tmp_path):
    """What a draw's scenario says: profiles go along with heights, slopes stay."""
    (tmp_path / "m.csv").write_text("time,x,y,z\n" + "".join(
        f"{t},{t},0,{0.1 * t - 0.3}\n" for t in range(4)))
    (tmp_path / "s.yaml").write_text(
        "soilvdb: 1\nvoxel_size: 0.1\nterrain: {plane: {z: 2.0, slope: [0.1, -0.2]}}\nmachines:\n"
        "  - name: digger\n    bucket: {width: 1.0, height: 0.8, profile: [[0, 0], [-0.5, 0.1], "
        "[-0.4, 0.7], [0, 0.8]]}\n    motion: m.csv\n")
    one = scene(tmp_path / "s.yaml", {"bucket": {"height": 0.1}, "terrain": {"bias": 0.5}})
    draw = one.study.noise.draw(2, 0)
    error = draw.scalar("bucket.height", 0.1, -1, 1, "digger")
    rise = draw.terrain((2, 2), (1, 1))[0, 0]
    assert abs(error) > 0.01 and abs(rise) > 0.01
    site = one._open(draw)
    values = yaml.safe_load((Path(one._folder.name) / "draw.yaml").read_text())
    bucket = values["machines"][0]["bucket"]
    scale = 1 + error / 0.8
    assert bucket["height"] == pytest.approx(0.8 + error)
    assert np.array(bucket["profile"]) == pytest.approx(np.array(
        [[0, 0], [-0.5, 0.1 * scale], [-0.4, 0.7 * scale], [0, 0.8 * scale]]))
    xy = np.array([[0.0, 0.0], [3.0, -2.0], [-1.0, 4.0]])
    assert site.mesh_heights(xy) == pytest.approx(2 + rise + xy @ [0.1, -0.2], abs=1e-5)


def test_scenarios_are_read_as_the_program_reads_them(tmp_path, uncertainty):
    """Numbers and names that YAML 1.1 takes for something else, a bucket that two machines share by an
    alias, names that a table and a plot have to quote, rows to be skipped, one without a motion."""
    pass_of = write_pass(tmp_path)
    urdf = ('<robot name="r"><link name="root"/><link name="bucket"/><joint name="x" type="prismatic">'
            '<parent link="root"/><child link="bucket"/><axis xyz="1 0 0"/><limit lower="0" upper="9" '
            'effort="0" velocity="9"/></joint></robot>')
    (tmp_path / "r.urdf").write_text(urdf)
    (tmp_path / "r.csv").write_text("time,x\n0,0\n5,2.5\n")
    rest = "urdf: r.urdf, lip: {link: bucket}"
    pass_of.write_text(
        "soilvdb: 1\nvoxel_size: 5e-2\nterrain: {plane: {z: 0e0}}\nmachines:\n"
        f"  - {{name: idle, bucket: &b {{width: 12e-1, height: 0.9}}, {rest}}}\n"
        "  - {name: 007, bucket: *b, motion: pass.csv}\n"
        "  - {name: 'on, $x$ $', bucket: *b, motion: pass.csv, bad_rows: skip}\n"
        f"  - {{name: on, bucket: *b, motion: r.csv, base: {{xyz: [0, 9, -0.25]}}, {rest}}}\n")
    (tmp_path / "noise.yaml").write_text("position: {bias: 1e-3}\nbucket: {width: 2e-2}\n")
    done = uncertainty(pass_of, tmp_path / "noise.yaml", tmp_path / "out", "--draws", 60)
    assert (done.returncode, done.stderr) == (0, "")
    report = json.loads((tmp_path / "out/uncertainty.json").read_text())
    names = ["007", "on, $x$ $", "on"]
    assert [machine["name"] for machine in report["machines"]] == names
    right = math.hypot(0.02 * LENGTH * DEPTH, 0.001 * WIDTH * LENGTH)
    for number in (0, 2):
        assert report["machines"][number]["cut_m3"]["sigma"] == pytest.approx(right, rel=0.35), number
    with open(tmp_path / "out/draws.csv", newline="", encoding="utf-8") as file:
        assert [row["machine"] for row in csv.DictReader(file)] == 60 * names


def test_what_is_the_same_in_all_draws_has_no_sigma():
    assert spread([0.1, 0.1, 0.1]) == {"mean": 0.1, "sigma": 0, "p05": 0.1, "p95": 0.1}
    assert first_order(np.full(3, 0.1), np.full(3, 0.1)) == (0, 0)


def test_a_worker_sees_that_a_motion_changed(tmp_path):
    scenario = write_pass(tmp_path)
    study = Study(str(scenario), noises.of({"position": {"bias": 0.01}}), 1)
    one = scene_of(study)
    assert scene_of(study) is one
    (tmp_path / "pass.csv").write_text("time,x,y,z\n0,0,0,-0.1\n5,2,0,-0.1\n")
    assert len(scene_of(study).motions["digger"]["times"]) == 2


def test_heights_have_a_sigma_where_only_draws_dig(tmp_path, uncertainty):
    """A lip that is recorded as just above the ground, and a place that is known to a metre."""
    (tmp_path / "noise.yaml").write_text("position: {bias: [0, 1, 0.02]}\n")
    done = uncertainty(write_pass(tmp_path, depths=[-0.001]), tmp_path / "noise.yaml",
                       tmp_path / "out", "--draws", 40)
    assert (done.returncode, done.stderr) == (0, "")
    heights, first, spacing, _ = soilvdb.read_raster(tmp_path / "out/height_sigma.tif")
    assert np.nanmax(heights) > 0.005
    assert np.nanmax(heights[0]) == np.nanmax(heights[-1]) == 0  # all of it is there


def test_a_draw_waits_where_terrain_ends(tmp_path, uncertainty):
    """As a clone of an ensemble; the others go on."""
    soilvdb.write_raster(tmp_path / "g.tif", np.zeros((21, 16)), (-2.0, -5.0), (0.4, 0.5))
    scenario = write_pass(tmp_path, terrain="{raster: g.tif}", length=3.9)
    (tmp_path / "noise.yaml").write_text("position: {bias: [0.1, 0, 0]}\n")
    done = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws", 20)
    assert done.returncode == 0
    warning = "draws come to ground without a height, and wait there; a terrain that has heights"
    assert done.stderr.startswith("soilvdb: warning: ") and warning in done.stderr
    assert done.stderr.count("\n") == 1
    cut = json.loads((tmp_path / "out/uncertainty.json").read_text())["machines"][0]["cut_m3"]
    assert 0 < cut["recorded"] - cut["p05"] < 0.3 and cut["sigma"] > 0.01


def test_a_motion_that_stops_is_told(tmp_path, uncertainty):
    scenario = write_pass(tmp_path)
    with open(tmp_path / "pass.csv", "a", encoding="utf-8") as motion:
        motion.write("7,nan,0,-0.1,0\n8,2,0,-0.1,0\n")
    (tmp_path / "noise.yaml").write_text(NOISE)
    done = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws", 2)
    assert done.returncode == 0 and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"soilvdb: warning: {tmp_path}/pass.csv:28: x is nan; ")
    assert done.stderr.endswith("; what is drawn ends before this row, as a run does\n")


def test_two_draws_have_a_sigma_while_others_use_dask(tmp_path):
    (tmp_path / "noise.yaml").write_text(NOISE)
    with socket.socket() as taken:
        with contextlib.suppress(OSError):  # then it is taken already
            taken.bind(("127.0.0.1", 8787))
            taken.listen()
        done = subprocess.run([*FLEET, "uncertainty", write_pass(tmp_path), "--noise",
                               tmp_path / "noise.yaml", "--out", tmp_path / "out", "--draws", "2"],
                              capture_output=True, text=True, check=False, timeout=500)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads((tmp_path / "out/uncertainty.json").read_text())["cut_m3"]["sigma"] > 0


def test_repose_angles_near_their_ends(tmp_path):
    scenario = write_pass(tmp_path, dump=True)
    for angle in (0.001, 1.57):
        body = "height: 0.9, profile: [[0, 0], [-0.5, 0.4], [0, 0.9]]"
        scenario.write_text(f"soil: {{repose_angle: {angle}}}\n"
                            + scenario.read_text().replace("height: 0.9", body))
        drawn = noises.of({"soil": {"repose": 1e-5}}).draw(1, 0)
        one = Scene(Study(str(scenario), drawn.noise, 1))
        one._open(drawn)
        scenario = write_pass(tmp_path, dump=True)


def test_loads_at_instants_and_sigma_of_heights(tmp_path):
    """Against draws that are dug here, one by one."""
    from soilvdb.fleet.uncertainty import (GRAINS_M, Task, _grid, draw_task, instants, recorded_of,
                                           sigma_of)

    scenario = write_pass(tmp_path, rows=11)
    one = scene(scenario, {"position": {"bias": 0.02}}, seed=9)
    grid = _grid(one, one.dig(None))
    recorded = recorded_of(one, grid)
    drawn = draw_task(Task(one.study, tuple((("position.bias", i),) for i in range(6)), grid))
    at = instants(one)
    rises = []
    for i in range(6):
        dug = one.dig(one.study.noise.draw(9, i))
        times, loads = one.motions["digger"]["times"], dug.load_m3["digger"]
        load = []
        for t in at:  # straight between rows
            row = min(np.flatnonzero(times <= t)[-1], len(times) - 2)
            share = (t - times[row]) / (times[row + 1] - times[row])
            load.append(loads[row] + share * (loads[row + 1] - loads[row]))
        assert drawn.figures[i].loads_m3["digger"] == pytest.approx(load)
        rises.append(dug.site.mesh_heights(grid.places()) - recorded.heights)
    rises = np.array(rises)
    assert sigma_of(drawn, 6) == pytest.approx(rises.std(axis=0, ddof=1), abs=1e-5)
    some = dataclasses.replace(drawn, count=np.where(np.arange(len(drawn.count)) < 5, 2, drawn.count))
    assert np.isnan(sigma_of(some, 6)[:5]).all() and np.isfinite(sigma_of(some, 6)[5:]).all()
    assert (drawn.count == 6).all()
    assert drawn.sum * GRAINS_M == pytest.approx(rises.sum(axis=0), abs=1e-5)
    assert drawn.squares * GRAINS_M**2 == pytest.approx((rises**2).sum(axis=0), abs=1e-6)


SOIL = {"repose_angle": 0.6, "swell": 0.2, "density": 1800, "cohesion": 5000,
        "friction_angle": 0.55, "tool_friction": 0.35}


def write_blade(folder, soil=SOIL, force="true", lifts=False):
    """A blade with a rake of 60 degrees through soil that moves, from the ground on."""
    rows = ["time,x,y,z,pitch"] + [f"{k / 4},{0.1 * k},0,-0.25,{-math.pi / 6}" for k in range(21)]
    if lifts:
        rows += ["8,2,0,0.8,0", "10,2,0,0.8,1.2"]
    (folder / "blade.csv").write_text("\n".join(rows) + "\n")
    bucket = {"width": 1.2, "height": 0.9, **({"dump_angle": 0.9} if lifts else {})}
    (folder / "blade.yaml").write_text(yaml.safe_dump({
        "soilvdb": 1, "voxel_size": 0.1, "terrain": {"plane": {"z": 0.0}}, "soil": soil,
        "machines": [{"name": "digger", "bucket": bucket, "motion": "blade.csv"}],
        "output": {"force": force == "true"}}))
    return folder / "blade.yaml"


def chi_square_bounds(count):
    """Of sigma found over sigma, from so many normal draws: 1 in 1000 is beyond either
    (Wilson and Hilferty)."""
    free = count - 1
    return [(1 - 2 / (9 * free) + z * math.sqrt(2 / (9 * free)))**1.5 for z in (-3.09, 3.09)]


def rows_of(file, **where):
    with open(file, newline="", encoding="utf-8") as text:
        return [row for row in csv.DictReader(text)
                if all(row[key] == value for key, value in where.items())]


def test_sigma_of_a_force_is_that_of_the_soil_times_the_derivative(tmp_path, uncertainty):
    draws, sigma = 80, 100.0
    scenario = write_blade(tmp_path)
    (tmp_path / "noise.yaml").write_text(f"soil: {{cohesion: {sigma}}}\n")
    done = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws", draws)
    assert (done.returncode, done.stderr) == (0, "")
    site = soilvdb.Site.open(scenario)
    motion = soilvdb.motions(scenario)["digger"]
    felt = []
    for row in range(len(motion["times"])):
        site.update_path("digger", **{key: rows[row:row + 1] for key, rows in motion.items()})
        felt.append(site.resistance("digger"))
    low, high = chi_square_bounds(draws)
    # The failure plane moves with the soil: that is of second order, below 1 % here.
    low, high = 0.99 * low, 1.01 * high
    rows = rows_of(tmp_path / "out/force.csv", machine="digger")
    assert [float(row["time"]) for row in rows] == motion["times"].tolist()
    for row, force in zip(rows, felt):
        for column, axis in (("force_x_n", 0), ("force_z_n", 2)):
            right = abs(force.jacobian[axis, 1]) * sigma
            assert float(row[column]) == pytest.approx(force.force[axis], rel=1e-6)
            assert low < float(row[f"{column}_sigma"]) / right < high
            assert float(row[f"{column}_p05"]) < float(row[f"{column}_mean"]) < float(
                row[f"{column}_p95"])
        assert float(row["moment_y_nm"]) == pytest.approx(force.moment[1], rel=1e-6)
        assert row["force_y_n_sigma"] == "0.0"
    most = max(felt, key=lambda force: np.linalg.norm(force.force))
    size = np.linalg.norm(most.force)
    right = abs(most.force @ most.jacobian[:, 1]) / size * sigma
    found = json.loads((tmp_path / "out/uncertainty.json").read_text())["machines"][0]
    assert list(found)[-1] == "force_n" and found["bucket_m3"]["sigma"] == 0
    assert found["force_n"]["recorded"] == pytest.approx(size)
    assert low < found["force_n"]["sigma"] / right < high
    assert found["force_n"]["sobol"]["soil.cohesion"]["first_order"] == 1
    drawn = [float(row["force_n"]) for row in rows_of(tmp_path / "out/draws.csv")]
    assert np.std(drawn, ddof=1) == pytest.approx(found["force_n"]["sigma"])
    assert "digger: largest force" in done.stdout and " kN (" in done.stdout


def test_forces_of_the_same_seed_are_the_same_bytes_with_any_workers(tmp_path, uncertainty):
    scenario = write_blade(tmp_path, lifts=True)
    (tmp_path / "noise.yaml").write_text(
        "position: {bias: [0, 0, 0.01]}\nsoil: {cohesion: 2000, friction_angle: 0.05, density: 60}\n")
    options = ("--draws", 24, "--seed", 3)
    two = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "two", *options)
    one = call("uncertainty", scenario, "--noise", tmp_path / "noise.yaml", "--out",
               tmp_path / "one", *options, "--workers", 1)
    assert one.returncode == two.returncode == 0
    for name in ("uncertainty.json", "draws.csv", "force.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    machine = json.loads((tmp_path / "one/uncertainty.json").read_text())["machines"][0]
    cycle = machine["cycles"][0]
    assert list(cycle)[-1] == "force_n" and len(machine["cycles"]) == 1
    assert cycle["force_n"] == {key: value for key, value in machine["force_n"].items()
                                if key != "sobol"}
    assert set(machine["force_n"]["sobol"]) == {"position.bias", "soil.cohesion", "soil.density",
                                                "soil.friction_angle"}
    # Without errors, and where forces aren't asked for.
    (tmp_path / "none.yaml").write_text("soil: {cohesion: 0}\nposition: {bias: 0}\n")
    uncertainty(scenario, tmp_path / "none.yaml", tmp_path / "none", "--draws", 3)
    machine = json.loads((tmp_path / "none/uncertainty.json").read_text())["machines"][0]
    force = machine["force_n"]
    assert force["sigma"] == 0 and force["mean"] == force["p95"] == force["recorded"] > 1000
    for row in rows_of(tmp_path / "none/force.csv"):
        assert row["force_x_n_sigma"] == "0.0" and row["force_x_n_mean"] == row["force_x_n"]
    write_blade(tmp_path, force="false")
    uncertainty(scenario, tmp_path / "none.yaml", tmp_path / "none", "--draws", 3)
    machine = json.loads((tmp_path / "none/uncertainty.json").read_text())["machines"][0]
    assert "force_n" not in machine and not (tmp_path / "none/force.csv").exists()
    assert "force_n" not in rows_of(tmp_path / "none/draws.csv")[0]


def test_draws_dig_with_the_soil_that_resists(tmp_path):
    """Cohesion, friction and density of a draw are those of its site, so its walls stand by them."""
    noise = {"soil": {"cohesion": 3000, "friction_angle": 0.1, "density": 200,
                      "tool_friction": 0.05}}
    one = scene(write_blade(tmp_path, lifts=True), noise)
    for number in range(4):
        draw = one.study.noise.draw(1, number)
        dug = one.dig(draw)
        soil = dug.site.soil
        for key in noise["soil"]:
            assert getattr(soil, key) == draw.soil(key, SOIL[key]) != SOIL[key]
        assert (soil.repose_angle, soil.swell, soil.adhesion) == (0.6, 0.2, 0)
        assert np.isfinite(dug.force["digger"]).all()
    weak = SOIL | {"cohesion": 100}
    soft = scene(write_blade(tmp_path, soil=weak, lifts=True), {"soil": {"cohesion": 90}})
    fills = {soft.dig(soft.study.noise.draw(1, number)).fill_m3 for number in range(6)}
    assert len(fills) > 1, "walls fail or stand"


def test_rows_that_wait_keep_their_force(tmp_path):
    soilvdb.write_raster(tmp_path / "g.tif", np.zeros((21, 16)), (-2.0, -5.0), (0.4, 0.5))
    scenario = write_blade(tmp_path)
    scenario.write_text(scenario.read_text().replace("plane:\n    z: 0.0", "raster: g.tif"))
    lines = (tmp_path / "blade.csv").read_text().splitlines()
    (tmp_path / "blade.csv").write_text("\n".join(
        [lines[0]] + [f"{k / 4},{1.9 + 0.1 * k},0,-0.25,0" for k in range(21)]) + "\n")
    noise = {"position": {"bias": [0.1, 0, 0]}}
    one = scene(scenario, noise)
    waits = [dug for dug in (one.dig(one.study.noise.draw(1, i)) for i in range(6)) if dug.waited]
    assert waits
    for dug in waits:
        force = dug.force["digger"]
        assert (force[-dug.waited:] == force[-dug.waited - 1]).all()
        assert force[4, 0] < 0 and np.isfinite(force).all()


@pytest.mark.parametrize("noise, soil, force, why", [
    ({"cohesion": 6000}, SOIL, "true", "soil.cohesion is 6000; it must be at most the soil's"),
    ({"friction_angle": 0.2}, SOIL, "true", "soil.friction_angle is 0.2; it must be at most a third"),
    ({"adhesion": 10}, SOIL, "true", "soil.adhesion is 10; it must be at most the soil's adhesion, 0"),
    ({"tool_friction": 0.1}, {"repose_angle": 0.6}, "true", "soil.tool_friction: the soil's tool_fric"),
    ({"tool_friction": 0.1}, SOIL, "false", "soil.tool_friction: changes forces only, and the scena"),
    ({"density": 10}, {"repose_angle": 0.6}, "false", "soil.density: changes forces only, and the s"),
])
def test_strength_that_can_not_err_so_is_refused(tmp_path, noise, soil, force, why):
    with pytest.raises(InputError) as error:
        scene(write_blade(tmp_path, soil=soil, force=force), {"soil": noise})
    assert str(error.value).startswith(f"noise: {why}"), str(error.value)


def test_many_rows_keep_some_forces():
    from soilvdb.fleet.forces import MOST_ROWS, kept_rows

    assert kept_rows(21).tolist() == list(range(21))
    many = kept_rows(100_003)
    assert len(many) == MOST_ROWS and (many[0], many[-1]) == (0, 100_002)
    assert (np.diff(many) > 200).all()


def test_a_machine_with_a_closed_tool_is_refused(tmp_path, uncertainty):
    scenario = write_pass(tmp_path)
    text = yaml.safe_load(scenario.read_text())
    text["machines"][0].pop("bucket")
    text["machines"][0]["tool"] = {"mesh": "box.stl"}
    (tmp_path / "box.stl").write_text("solid box\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join(f"vertex {x} {y} {z}\n" for x, y, z in corners)
        + "endloop\nendfacet\n" for corners in TETRAHEDRON) + "endsolid box\n")
    scenario.write_text(yaml.safe_dump(text))
    (tmp_path / "noise.yaml").write_text("position: {white: 0.001}\n")
    refused = uncertainty(scenario, tmp_path / "noise.yaml", tmp_path / "out", "--draws", 4)
    assert refused.returncode == 2
    assert "has a closed tool; a study knows buckets only" in refused.stderr
    assert refused.stderr.count("\n") == 1


_A, _B, _C, _D = (0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)
TETRAHEDRON = [(_A, _C, _B), (_A, _B, _D), (_A, _D, _C), (_B, _C, _D)]
