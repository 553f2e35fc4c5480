# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""One scenario in parts on a cluster: what one process digs, whoever is killed meanwhile."""

import json
import random
import signal
import subprocess

import pytest
import soilvdb
from processes import FLEET, LONG, Processes, call, fleet_split, wait_until, write_shift


def one_process(scenario, out):
    """@return what is the same each time of a run by one process"""
    soilvdb.run(scenario, out, threads=1)
    return lasting(out)


def lasting(out):
    summary = json.loads((out / "summary.json").read_text())
    rows = [line.rpartition(",")[0] for line in (out / "updates.csv").read_text().splitlines()]
    return ({key: summary[key] for key in ("state_hash", "volume_m3", "machines", "updates", "soil",
                                           "files")}, rows, (out / "soil_final.vdb").read_bytes())


def finished_parts(out):
    return sum(1 for _ in out.glob("parts/*_*/summary.json"))


@pytest.fixture(name="crossing")
def _crossing(tmp_path):
    """Four machines, of which two change places half-way."""
    scenario = write_shift(tmp_path / "site", machines=4, hours=0.1 if LONG else 0.04)
    first, second = (tmp_path / "site" / f"m{m}.csv" for m in (0, 1))
    a, b = first.read_text().splitlines(), second.read_text().splitlines()
    half = len(a) // 2 // 240 * 240 + 1  # between two cycles
    gone = half - 50                      # they take five seconds

    def places_of(times, others):
        return [f"{t.split(',')[0]},{o.partition(',')[2]}" for t, o in zip(times, others)]

    first.write_text("\n".join(a[:gone] + places_of(a, b)[half:]) + "\n")
    second.write_text("\n".join(b[:gone] + places_of(b, a)[half:]) + "\n")
    return scenario


def test_a_shift_of_ten_in_eight_is_that_of_one_process(tmp_path, fleet):
    scenario, out = write_shift(tmp_path / "site"), tmp_path / "out"
    done = fleet_split(scenario, out, 8, "--workers", 2)
    assert (done.returncode, done.stderr) == (0, "")
    assert "in 8 parts in 1 window;" in done.stdout
    assert lasting(out) == one_process(scenario, tmp_path / "whole")
    assert not (out / "parts").exists()
    before = (out / "summary.json").read_bytes()
    again = fleet("split", scenario, "--out", out, "--parts", 8)
    assert again.returncode == 0 and (out / "summary.json").read_bytes() == before


def test_workers_and_the_scheduler_may_die(tmp_path, crossing):
    out, chance = tmp_path / "out", random.Random(5)
    with Processes(tmp_path, hosts=(1, 1)) as cluster:
        process = subprocess.Popen(
            [*FLEET, "split", crossing, "--out", out, "--parts", "4", "--scheduler",
             cluster.address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for step in range(4) if LONG else (1, 2):
            wait_until(lambda want=2 * step: finished_parts(out) >= want
                       or process.poll() is not None)
            chance.choice(cluster.workers).kill()
            if step == 2:
                cluster.scheduler.kill()
        said, error = process.communicate(timeout=400)
    assert process.returncode == 0, error
    assert "in 1 window;" not in said, "places are changed"
    assert lasting(out) == one_process(crossing, tmp_path / "whole")


def test_the_same_command_goes_on(tmp_path, crossing, fleet, shared):
    out = tmp_path / "out"
    command = [*FLEET, "split", crossing, "--out", out, "--parts", "4", "--scheduler", shared]
    for parts in (1, 4):
        with subprocess.Popen(command, stdout=subprocess.DEVNULL,
                              stderr=subprocess.DEVNULL) as process:
            wait_until(lambda want=parts: finished_parts(out) >= want
                       or process.poll() is not None)
            process.send_signal(signal.SIGKILL)
    assert not (out / "summary.json").exists()
    done = fleet("split", crossing, "--out", out, "--parts", 4)
    assert done.returncode == 0, done.stderr
    assert lasting(out) == one_process(crossing, tmp_path / "whole")


def test_a_part_that_fails_is_told_and_dug_once_that_is_mended(tmp_path, fleet):
    scenario, out = write_shift(tmp_path / "site", machines=3), tmp_path / "out"
    (out / "parts").mkdir(parents=True)
    (out / "parts/0_1").write_text("in the way")
    done = fleet("split", scenario, "--out", out, "--parts", 3)
    assert done.returncode == 1 and done.stderr.count("\n") == 1, done.stderr
    assert "parts/0_1" in done.stderr and "the same command goes on" in done.stderr
    assert finished_parts(out) == 2
    (out / "parts/0_1").unlink()
    assert fleet("split", scenario, "--out", out, "--parts", 3).returncode == 0
    assert lasting(out) == one_process(scenario, tmp_path / "whole")


@pytest.mark.parametrize("machines,soil,why", [
    (1, "", "it has one machine"),
    (2, "soil: {repose_angle: 0.6}\n", "it has 'soil:'"),
])
def test_what_cant_be_split_is_refused(tmp_path, machines, soil, why):
    scenario = write_shift(tmp_path / "site", machines=machines, hours=0.01)
    scenario.write_text(scenario.read_text() + soil)
    refused = call("split", scenario, "--out", tmp_path / "out", "--parts", 2)
    assert refused.returncode == 2 and not (tmp_path / "out").exists()
    assert refused.stderr.startswith(f"soilvdb: {scenario}: can't be split: ")
    assert why in refused.stderr and refused.stderr.count("\n") == 1


def test_wrong_command_lines_are_told(tmp_path, fleet, shared, monkeypatch):
    scenario = write_shift(tmp_path / "site", machines=2, hours=0.01)
    out = tmp_path / "out"
    refused = call("split", scenario, "--out", out, "--parts", 1)
    assert refused.returncode == 2 and "'1' is no whole number from 2 to 1024" in refused.stderr
    refused = call("split", scenario, "--out", out, "--parts", 2, "--voxel", "nan")
    assert refused.returncode == 2 and "--voxel" in refused.stderr
    assert refused.stderr.count("\n") == 1 and not out.exists()
    dashed = scenario.rename(scenario.with_name("-s.yaml"))
    monkeypatch.chdir(dashed.parent)
    done = call("split", "--out=-o", "--parts=2", f"--scheduler={shared}", "--", "-s.yaml")
    assert (done.returncode, done.stderr) == (0, "") and (dashed.parent / "-o/summary.json").exists()
    dashed.rename(scenario)
    assert fleet("split", scenario, "--out", out, "--parts", 2).returncode == 0
    refused = call("split", scenario, "--out", out, "--parts", 2, "--updates", 7)
    assert refused.returncode == 2 and "--updates was another" in refused.stderr


def test_without_a_folder_it_is_named_as_the_scenario(tmp_path, fleet, monkeypatch):
    write_shift(tmp_path, machines=2, hours=0.01)
    monkeypatch.chdir(tmp_path)
    assert fleet("split", "shift.yaml", "--parts", 2).returncode == 0
    assert lasting(tmp_path / "out/shift") == one_process(tmp_path / "shift.yaml", tmp_path / "whole")
