# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster of processes that are killed and started again, and jobs for it.

Also for bench/fleet.py.
"""

import contextlib
import csv
import dataclasses
import io
import os
import signal
import socket
import subprocess
import sys
import threading
import time

import distributed

from soilvdb.fleet.__main__ import main

LONG = "SOILVDB_LONG" in os.environ  # tools/test --long
FLEET = [sys.executable, "-m", "soilvdb.fleet"]

SCENARIO = """soilvdb: 1
voxel_size: 0.05
terrain: {plane: {z: 0.0, slope: [0.1, 0.0]}}
machines:
  - {name: digger, bucket: {width: 0.8, height: 0.6}, motion: dig.csv}
"""
MOTION = """time,x,y,z,pitch
0.0, 0.0, 0.0,  0.10, 0.3
1.0, 0.4, 0.0, -0.27, 0.1
3.0, 2.0, 0.0, -0.27, 0.0
4.0, 2.5, 0.0,  0.40, -0.8
"""


def write_jobs(folder, rows, name="jobs.csv"):
    """A manifest, with a scenario beside it. rows: dicts without `scenario`. @return its path"""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "dig.yaml").write_text(SCENARIO)
    (folder / "dig.csv").write_text(MOTION)
    with open(folder / name, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, ["job", "scenario", *list(rows[0])[1:]])
        table.writeheader()
        table.writerows({"scenario": "dig.yaml", **row} for row in rows)
    return folder / name


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Kept:
    """A process that is started again whenever it ends, as systemd would."""

    def __init__(self, command, **more):
        self._command, self._more = command, more
        self._stopped = False
        self.process = self._start()
        self._thread = threading.Thread(target=self._keep)
        self._thread.start()

    def _start(self):
        return subprocess.Popen(self._command, stdout=subprocess.DEVNULL,
                                stderr=subprocess.DEVNULL, **self._more)

    def _keep(self):
        while True:
            self.process.wait()
            if self._stopped:
                return
            self.process = self._start()

    def kill(self):
        self.process.send_signal(signal.SIGKILL)

    def stop(self):
        self._stopped = True
        while self._thread.is_alive():  # it may just have been started again
            self.process.kill()
            self._thread.join(0.1)


class Processes:
    """A scheduler and workers, each at 127.0.0.<host>, to be used by `with`."""

    def __init__(self, folder, hosts=(1, 1), environments=None):
        self.address = f"tcp://127.0.0.1:{free_port()}"
        module = [sys.executable, "-m", "distributed.cli."]
        self.scheduler = Kept([*module[:2], module[2] + "dask_scheduler", "--host", "127.0.0.1",
                               "--port", self.address.rpartition(":")[2], "--no-dashboard"],
                              cwd=folder)
        self.workers = [
            Kept([*module[:2], module[2] + "dask_worker", self.address, "--host", f"127.0.0.{host}",
                  "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory",
                  str(folder / "dask")], cwd=folder,
                 env={**os.environ, **(environments or {}).get(host, {})}) for host in hosts]

    def wait_for_workers(self, count):
        end = time.monotonic() + 120
        while True:
            try:
                with distributed.Client(self.address, timeout=10, set_as_default=False) as client:
                    client.wait_for_workers(count, timeout=120)
                return
            except OSError:  # of a scheduler that was just killed
                assert time.monotonic() < end
                time.sleep(0.2)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for each in [*self.workers, self.scheduler]:
            each.stop()


def fleet_run(manifest, out, *options, **more):
    """@return the finished process"""
    return subprocess.run([*FLEET, "run", str(manifest), "--out", str(out), *map(str, options)],
                          capture_output=True, text=True, check=False, timeout=500, **more)


@dataclasses.dataclass
class Done:
    """What a command ended with, as subprocess has it."""

    returncode: int
    stdout: str
    stderr: str


def call(*words):
    """python3 -m soilvdb.fleet, in this process. @return Done"""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main([*map(str, words)])
    return Done(status, out.getvalue(), err.getvalue())


def lasting(table):
    """Columns of results.csv that are the same each time, as text."""
    rows = list(csv.reader(table.open(newline="", encoding="utf-8")))
    end = rows[0].index("update_us.mean")
    return "\n".join(",".join(row[:end]) for row in rows)


def done_count(out):
    return sum(1 for _ in out.glob("*/summary.json"))


def wait_until(what, timeout_s=120.0):
    end = time.monotonic() + timeout_s
    while not what():
        assert time.monotonic() < end, "never happened"
        time.sleep(0.02)
