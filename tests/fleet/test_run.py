# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many jobs: what a cluster of processes digs, killed into or not, is what one after another is."""

import ast
import contextlib
import csv
import errno
import gc
import json
import multiprocessing
import os
import random
import signal
import socket
import subprocess
import sys
import time
import types
from pathlib import Path

import distributed
import pytest
import soilvdb
from processes import (FLEET, LONG, SCENARIO, Processes, call, done_count, fleet_run, lasting,
                       wait_until, write_jobs)
from soilvdb._run import _program
from soilvdb.fleet import cluster
from soilvdb.fleet.jobs import run_job
from soilvdb.fleet.manifest import read_manifest

MANY = 100_000  # updates, about a second


def rows(table):
    return list(csv.DictReader(table.open(newline="", encoding="utf-8")))


def job_of(manifest, out, index=0):
    return read_manifest(manifest, out)[index]


def programs(folder):
    """The program's processes that are at work in a folder."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if words[0].endswith(b"soilvdb") and os.fsencode(folder) in words:
            found.append(int(process.name))
    return found


def in_process(job):
    process = multiprocessing.get_context("spawn").Process(target=run_job, args=(job,))
    process.start()
    return process


def test_a_table_has_each_figure_of_each_summary(tmp_path):
    manifest = write_jobs(tmp_path, [
        {"job": "fine", "voxel": "0.025", "updates": "50", "threads": "", "memory": "64"},
        {"job": "coarse", "voxel": "", "updates": "", "threads": "2", "memory": ""},
        {"job": "many", "voxel": "", "updates": "300", "threads": "", "memory": ""}])
    done = fleet_run(manifest, tmp_path / "out", "--workers", 2)
    assert (done.returncode, done.stderr) == (0, ""), "nothing of a bar when piped"
    assert done.stdout.startswith("3 of 3 jobs done in ")
    table = rows(tmp_path / "out/results.csv")
    assert [row["job"] for row in table] == ["fine", "coarse", "many"]
    options = [{"voxel": 0.025, "updates": 50, "threads": 1}, {"threads": 2},
               {"updates": 300, "threads": 1}]
    for row, option in zip(table, options):
        wanted = soilvdb.run(tmp_path / "dig.yaml", tmp_path / "alone" / row["job"], **option)
        assert row["scenario"] == "dig.yaml" and row["host"] == os.uname().nodename
        assert row["state_hash"] == wanted["state_hash"]
        assert row["threads"] == str(option["threads"])
        assert float(row["volume_m3.cut"]) == wanted["volume_m3"]["cut"] > 0.1
        assert float(row["machines.digger.bucket_m3"]) == wanted["machines"][0]["bucket_m3"]
        made = json.loads((tmp_path / "out" / row["job"] / "summary.json").read_text())
        assert float(row["wall_s.total"]) == made["wall_s"]["total"]
        assert int(row["memory_bytes.peak_rss"]) == made["memory_bytes"]["peak_rss"]
        count = sum(1 for _ in leaves({k: v for k, v in made.items()
                                       if k not in ("soilvdb", "scenario", "files")}))
        assert sum(1 for text in row.values() if text) == count + 3, "job, scenario, host"
    assert (tmp_path / "out/failed.csv").read_text() == "job,exit_status,message\n"


def leaves(value):
    if isinstance(value, dict):
        for key, inner in value.items():
            if key != "name":
                yield from leaves(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from leaves(inner)
    else:
        yield value


def test_jobs_that_are_done_are_not_dug_again(tmp_path, fleet):
    manifest = write_jobs(tmp_path, [{"job": "a", "updates": 50}, {"job": "b", "updates": 60}])
    out = tmp_path / "out"
    assert fleet("run", manifest, "--out", out).returncode == 0
    before = (out / "results.csv").read_bytes()
    (out / "results.csv").unlink()
    (out / "a/soil_final.vdb").unlink()
    assert fleet("run", manifest, "--out", out).returncode == 0
    assert (out / "results.csv").read_bytes() == before, "times, too"
    (out / "results.csv").unlink()
    assert call("run", manifest, "--out", out, "--gather").returncode == 0
    assert (out / "results.csv").read_bytes() == before
    (out / "a/summary.json").write_text("{}")
    assert fleet("run", manifest, "--out", out).returncode == 0
    assert rows(out / "results.csv")[0]["volume_m3.cut"] == \
        next(csv.DictReader(before.decode().splitlines()))["volume_m3.cut"]


def test_a_run_that_was_stopped_is_gone_on_with(tmp_path):
    manifest = write_jobs(tmp_path, [{"job": "a", "updates": MANY}])
    out = tmp_path / "out"
    process = in_process(job_of(manifest, out))
    wait_until(lambda: (out / "a/updates.csv.part").exists() or done_count(out))
    for program in programs(out / "a"):
        os.kill(program, signal.SIGTERM)  # it writes a summary of what it has
    process.join()
    assert process.exitcode == 1 and done_count(out) == 1
    call("run", manifest, "--out", out, "--gather")
    assert rows(out / "results.csv") == [], "half a job is no result"
    assert rows(out / "failed.csv")[0]["message"] == "isn't finished"
    summary = run_job(job_of(manifest, out)).summary
    assert summary["updates"] == MANY
    alone = soilvdb.run(tmp_path / "dig.yaml", tmp_path / "alone", updates=MANY, threads=1)
    assert summary["state_hash"] == alone["state_hash"]
    assert summary["volume_m3"] == alone["volume_m3"]


def test_a_killed_program_is_gone_on_with_at_once(tmp_path):
    manifest = write_jobs(tmp_path, [{"job": "a", "updates": MANY}])
    out = tmp_path / "out"
    process = in_process(job_of(manifest, out))
    wait_until(lambda: (out / "a/updates.csv.part").exists())
    killed = programs(out / "a")
    for program in killed:
        os.kill(program, signal.SIGKILL)
    process.join()
    assert killed and process.exitcode == 0
    alone = soilvdb.run(tmp_path / "dig.yaml", tmp_path / "alone", updates=MANY, threads=1)
    assert run_job(job_of(manifest, out)).summary["volume_m3"] == alone["volume_m3"]


def test_no_program_outlives_its_worker(tmp_path):
    manifest = write_jobs(tmp_path, [{"job": "a", "updates": 1000 * MANY}])
    process = in_process(job_of(manifest, tmp_path / "out"))
    wait_until(lambda: (tmp_path / "out/a/updates.csv.part").exists())
    assert len(programs(tmp_path / "out/a")) == 1
    process.kill()
    wait_until(lambda: not programs(tmp_path / "out/a"), timeout_s=5)


def test_two_at_the_same_job_dig_it_once(tmp_path):
    manifest = write_jobs(tmp_path, [{"job": "a", "updates": MANY}])
    job = job_of(manifest, tmp_path / "out")
    processes = [in_process(job) for _ in range(3)]
    most = 0
    while any(process.is_alive() for process in processes):
        most = max(most, len(programs(job.folder)))
        time.sleep(0.05)
    assert [process.exitcode for process in processes] == [0, 0, 0] and most == 1
    record = (job.folder / "job.json").stat().st_mtime_ns
    run_job(job)
    assert (job.folder / "job.json").stat().st_mtime_ns == record


def test_workers_that_die_and_schedulers_that_are_restarted_change_no_bit(tmp_path):
    """A smaller one of tools/bench fleet's."""
    chance = random.Random(18)
    jobs = [{"job": f"j{i}", "updates": chance.choice([40, 400, 60_000])}
            for i in range(60 if LONG else 9)]
    manifest = write_jobs(tmp_path, jobs)
    out = tmp_path / "out"
    with Processes(tmp_path, hosts=(1, 1, 1)) as processes:
        process = subprocess.Popen(
            [*FLEET, "run", manifest, "--out", out, "--scheduler", processes.address],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            for kills, done in enumerate(range(4, 52, 6) if LONG else (2, 5)):
                wait_until(lambda at=done: done_count(out) >= at or process.poll() is not None)
                assert process.poll() is None
                chance.choice(processes.workers).kill()
                if kills in (2, 5) if LONG else kills == 1:
                    processes.scheduler.kill()
            said = process.communicate(timeout=300)
        finally:
            process.kill()
    assert process.returncode == 0 and said[1] == ""
    for job in read_manifest(manifest, tmp_path / "serial"):
        run_job(job)
    call("run", manifest, "--out", tmp_path / "serial", "--gather")
    assert lasting(out / "results.csv") == lasting(tmp_path / "serial/results.csv")
    assert len(rows(out / "results.csv")) == len(jobs)
    for job in jobs:
        verified = subprocess.run([_program(), "verify", out / job["job"]], capture_output=True,
                                  check=False)
        assert verified.returncode == 0


def test_schedulers_may_be_restarted_more_often_than_jobs_may_fail(tmp_path):
    attempts = 3 if LONG else 1
    jobs = [{"job": name, "updates": attempts * MANY} for name in ("a", "b", "c")]
    manifest = write_jobs(tmp_path, jobs)
    out = tmp_path / "out"
    patient = (f"import sys; from soilvdb.fleet import __main__, cluster; cluster.ATTEMPTS = {attempts}; "
               "sys.exit(__main__.main(sys.argv[1:]))")
    with Processes(tmp_path) as processes:
        process = subprocess.Popen(
            [sys.executable, "-c", patient, "run", manifest, "--out", out, "--scheduler",
             processes.address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        try:
            wait_until(lambda: programs(out / "a"))
            for _ in range(attempts + 1):  # workers of one that is gone end when their program does
                assert process.poll() is None
                processes.scheduler.kill()
                processes.wait_for_workers(1)
            said = process.communicate(timeout=300)
        finally:
            process.kill()
    assert (process.returncode, said[1]) == (0, "")
    assert [row["updates"] for row in rows(out / "results.csv")] == [str(attempts * MANY)] * 3


def test_a_client_that_is_closed_while_it_looks_for_its_scheduler_leaves_nothing_behind():
    """Python says of each coroutine that ends with it: "Exception ignored in ..."."""
    with distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None) as local:
        one = cluster.Cluster(local.scheduler_address)
    client = one.client
    wait_until(lambda: client.status == "connecting")
    client.loop.add_callback(time.sleep, 2.5)  # as on a busy host
    one.close()
    assert client.status == "closed"
    left = [thing for thing in gc.get_objects() if isinstance(thing, types.CoroutineType)
            and thing.cr_frame is not None and thing.cr_frame.f_locals.get("self") is client]
    assert left == []


@pytest.mark.skipif("SOILVDB_IO_SHIM" not in os.environ, reason="that fills disks; ctest builds it")
def test_a_full_disk_on_one_host_is_another_host_s_work(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "PAUSE_S", 0.0)
    jobs = [{"job": f"j{i}", "updates": 400} for i in range(12 if LONG else 4)]
    manifest = write_jobs(tmp_path, jobs)
    out = tmp_path / "out"
    full = {"LD_PRELOAD": os.environ["SOILVDB_IO_SHIM"], "SHIM_FOLDER": str(out),
            "SHIM_LOG": str(tmp_path / "shim.log"), "SHIM_FAULT": f"short 20 {errno.ENOSPC}"}
    with Processes(tmp_path, hosts=(1, 2), environments={2: full}) as processes:
        processes.wait_for_workers(2)
        done = call("run", manifest, "--out", out, "--scheduler", processes.address)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "shim.log").stat().st_size > 0
    for job in read_manifest(manifest, tmp_path / "serial"):
        run_job(job)
    call("run", manifest, "--out", tmp_path / "serial", "--gather")
    assert lasting(out / "results.csv") == lasting(tmp_path / "serial/results.csv")
    with Processes(tmp_path, hosts=(2,), environments={2: full}) as processes:
        done = call("run", manifest, "--out", tmp_path / "out/all", "--scheduler", processes.address)
    assert done.returncode == 1
    assert rows(tmp_path / "out/all/results.csv") == []
    failed = rows(tmp_path / "out/all/failed.csv")
    assert [row["job"] for row in failed] == [job["job"] for job in jobs]
    assert all(row["exit_status"] == "1" and os.strerror(errno.ENOSPC) in row["message"]
               for row in failed)


def test_jobs_that_fail_are_listed_and_the_others_done(tmp_path, fleet):
    manifest = write_jobs(tmp_path, [{"job": "good"}, {"job": "bad"}, {"job": "other"}])
    (tmp_path / "bad.yaml").write_text(SCENARIO.replace("voxel_size", "voxl_size"))
    manifest.write_text("job,scenario\ngood,dig.yaml\nbad,bad.yaml\nother,dig.yaml\n")
    out = tmp_path / "out"
    done = fleet("run", manifest, "--out", out)
    assert done.returncode == 1
    assert done.stderr.startswith(f"soilvdb: without a result: 1 of 3 jobs, see {out}/failed.csv; "
                                  f"'bad': {tmp_path}/bad.yaml:2: unknown key 'voxl_size'")
    assert done.stderr.count("\n") == 1
    assert [row["job"] for row in rows(out / "results.csv")] == ["good", "other"]
    failed, = rows(out / "failed.csv")
    assert (failed["job"], failed["exit_status"]) == ("bad", "2")
    assert failed["message"].startswith(f"{tmp_path}/bad.yaml:2: unknown key 'voxl_size'")
    (tmp_path / "bad.yaml").write_text(SCENARIO)
    assert fleet("run", manifest, "--out", out).returncode == 0, "once it is mended"
    (tmp_path / "bad.yaml").write_text(SCENARIO.replace("0.05", "0.025"))
    assert fleet("run", manifest, "--out", out).returncode == 1
    assert "holds another job" in rows(out / "failed.csv")[0]["message"]


@pytest.mark.parametrize("text, line, what", [
    ("job,scenario,voxl\na,dig.yaml,1\n", 1, "unknown column 'voxl'; did you mean 'voxel'?"),
    ("job,job,scenario\n", 1, "the column 'job' is there twice"),
    ("job\na\n", 1, "the column 'scenario' is missing"),
    ("job,scenario\na,dig.yaml\n\na,dig.yaml\n", 4, "the job 'a' is in line 2 already"),
    ("job,scenario\na/b,dig.yaml\n", 2, "the job 'a/b' can't be the name of a folder"),
    ("job,scenario\n..,dig.yaml\n", 2, "the job '..' can't be the name of a folder"),
    (f"job,scenario\n{'ä' * 128},dig.yaml\n", 2, "can't be the name of a folder"),
    ("job,scenario\nresults.csv,dig.yaml\n", 2, "'results.csv' is the name"),
    ("job,scenario\na,gone.yaml\n", 2, "there is no scenario 'gone.yaml'"),
    ("job,scenario\na,\n", 2, "there is no scenario ''"),
    ("job,scenario\na,dig.yaml,3\n", 2, "3 cells; there are 2 columns"),
    ("job,scenario,voxel\na,dig.yaml,nan\n", 2, "voxel is 'nan'; it must be a voxel size from 0.0001"),
    ("job,scenario,voxel\na,dig.yaml,5 cm\n", 2, "voxel is '5 cm'"),
    ("job,scenario,updates\na,dig.yaml,1.5\n", 2, "updates is '1.5'; it must be a whole number"),
    ("job,scenario,threads\na,dig.yaml,0\n", 2, "threads is '0'"),
    ("job,scenario,memory\na,dig.yaml,8\n", 2, "memory is '8'; it must be a whole number of MB from 16"),
    ('job,scenario\n"a,dig.yaml\n', 2, "it must be a CSV file"),
    ('job,scenario\n"a\nb",dig.yaml\n', 3, r"the job 'a\nb' can't be the name of a folder"),
    ('job,scenario,"a\nb"\n', 2, r"unknown column 'a\nb'"),
    ('job,scenario\na,"\x1b[2Jb.yaml"\n', 2, r"there is no scenario '\x1b[2Jb.yaml'"),
    (f"job,scenario\na,{'x' * 300}\n", 2, "there is no scenario 'xxx"),
    ("job,scenario\n.results.csv.tmp,dig.yaml\n", 2, "'.results.csv.tmp' is the name"),
])
def test_a_wrong_manifest_is_told_in_one_line(tmp_path, text, line, what):
    manifest = write_jobs(tmp_path, [{"job": "a"}])
    manifest.write_text(text)
    done = call("run", manifest, "--out", tmp_path / "out", "--workers", 1)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert done.stderr.startswith(f"soilvdb: {manifest}:{line}: ") and what in done.stderr
    assert not (tmp_path / "out").exists(), "nothing is written"


@pytest.mark.parametrize("options, what", [
    (["run"], "are required"),
    (["run", "gone.csv", "--out", "o"], "gone.csv: No such file"),
    (["run", "jobs.csv", "--out", "jobs.csv"], "can't be made a folder"),
    (["run", "jobs.csv", "--out", "o", "--workers", "0"], "'0' is not a whole number from 1"),
    (["run", "jobs.csv", "--out", "o", "--job", "1"], "there are jobs 0 to 0"),
    (["run", "jobs.csv", "--out", "o", "--scheduler", "nowhere://x"], "is not an address"),
    (["run", "jobs.csv", "--out", "o", "--scheduler", "tcp://localhost:99999"], "is not an address"),
    (["run", "jobs.csv", "--out", "o", "--scheduler", "tls://localhost:1"], "needs certificates"),
    (["runs"], "invalid choice"),
])
def test_a_wrong_command_line_is_told_in_one_line(tmp_path, monkeypatch, options, what):
    write_jobs(tmp_path, [{"job": "a"}])
    monkeypatch.chdir(tmp_path)
    done = call(*options)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert done.stderr.startswith("soilvdb: ") and what in done.stderr
    assert not (tmp_path / "o").exists(), "nothing is written"


def test_paths_that_are_no_text_are_told_all_the_same(tmp_path, shared, fleet):
    manifest = write_jobs(tmp_path, [{"job": "a"}])
    out = os.fsdecode(os.fsencode(tmp_path / "out") + b"\xff")
    done = fleet_run(manifest, out, "--scheduler", shared)
    assert (done.returncode, done.stderr) == (0, "") and r"\udcff/results.csv" in done.stdout
    manifest.write_text("job,scenario\na,dig.yaml\nbad,bad.yaml\n")
    (tmp_path / "bad.yaml").write_text("soilvdb: 1\n")
    Path(out, "bad").write_text("in the way")
    done = fleet("run", manifest, "--out", out)
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert "out\\udcff/bad" in rows(Path(out, "failed.csv"))[0]["message"]


def test_two_at_once_on_one_host_are_not_at_odds(tmp_path):
    manifest = write_jobs(tmp_path, [{"job": "a", "updates": 40}])
    with socket.socket() as taken:  # the port of Dask's dashboard, which another may have
        with contextlib.suppress(OSError):
            taken.bind(("127.0.0.1", 8787))
            taken.listen()
        done = fleet_run(manifest, tmp_path / "out", "--workers", 1)
    assert (done.returncode, done.stderr) == (0, "")


def test_an_array_script_digs_each_job_once_and_gathers(tmp_path):
    """By a stand-in for sbatch, which runs arrays at once."""
    manifest = write_jobs(tmp_path / "a b", [{"job": f"it's {i}", "updates": 30 + i, "threads": 2}
                                             for i in range(3)])
    out = tmp_path / "o u t %A"
    done = fleet_run(manifest, out, "--slurm")
    assert done.returncode == 0 and done_count(out) == 0
    sbatch = tmp_path / "bin/sbatch"
    sbatch.parent.mkdir()
    sbatch.write_text(f"#!{sys.executable}\n" + """
import os, subprocess, sys
print("7;cluster")
open(os.environ["CALLS"], "a").write(repr(sys.argv[1:]) + "\\n")
options = dict(word.split("=", 1) for word in sys.argv[1:] if "=" in word and word[:2] == "--")
first, last = options.get("--array", "0-0").split("-")
for i in range(int(first), int(last) + 1):
    subprocess.run(["sh", "-c", sys.argv[sys.argv.index("--wrap") + 1]], check=True,
                   stdout=subprocess.DEVNULL, env={**os.environ, "SLURM_ARRAY_TASK_ID": str(i)})
""")
    sbatch.chmod(0o755)
    environment = {**os.environ, "PATH": f"{sbatch.parent}:{os.environ['PATH']}",
                   "CALLS": str(tmp_path / "calls")}
    subprocess.run(["sh", out / "slurm.sh", "--time=60"], check=True, env=environment,
                   capture_output=True, cwd="/")
    array, tables = map(ast.literal_eval, (tmp_path / "calls").read_text().splitlines())
    assert f"--output={tmp_path}/o u t %%A/slurm/%A_%a.log" in array
    assert {"--array=0-2", "--cpus-per-task=2", "--time=60"} <= set(array)
    assert "--dependency=afterany:7" in tables
    assert [row["updates"] for row in rows(out / "results.csv")] == ["30", "31", "32"]
