# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""fleet split: one scenario as parts that are dug apart, merged to what one process digs.

`soilvdb part` knows how: a plan says which machines never meet in which window of time, a part is a
run folder of its own in DIR/parts, and what the parts of a window left is merged before the next.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .._run import _program
from . import InputError, cluster
from .jobs import JOURNAL, JobError, locked, run_program
from .progress import Progress

PLAN, PARTS = "plan.json", "parts"


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "split", help="dig one scenario in parts", allow_abbrev=False,
        description="Digs one scenario as parts, of machines that never meet in a window of its "
                    "time, and merges them to the run folder DIR, as one process would have left "
                    "it to the last bit. The same command goes on with what was left.")
    parser.add_argument("scenario", metavar="SCENARIO", type=Path)
    parser.add_argument("--out", metavar="DIR", type=Path,
                        help="on a disk that all workers share; default: out/<scenario file's name>")
    parser.add_argument("--parts", metavar="N", type=_parts, required=True,
                        help="most of them side by side; as many as there are workers")
    for name, kind, meaning in (
            ("voxel", float, "voxel size instead of the scenario's, m"),
            ("updates", int, "of each machine, even in time; default: one per row"),
            ("memory", int, "most that the ground of a part may hold, MB")):
        parser.add_argument(f"--{name}", metavar=name[0].upper(), type=kind, help=meaning)
    cluster.add_options(parser)
    parser.set_defaults(main=main)


def _parts(text: str) -> int:
    if not text.isdecimal() or not 2 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number from 2 to 1024")
    return int(text)


@dataclasses.dataclass(frozen=True)
class Task:
    """A call of the program. Paths are absolute: workers run elsewhere."""

    words: tuple[str, ...]
    folder: Path  # of its lock


def perform(task: Task) -> None:
    """Attempts at the same wait for one another; the later find it done. Raises JobError."""
    try:
        task.folder.mkdir(parents=True, exist_ok=True)
        with locked(task.folder) as lock:
            run_program(lambda: [_program(), *task.words], lock)
    except (OSError, RuntimeError) as error:
        raise JobError(1, str(error)) from error


def main(arguments: argparse.Namespace) -> int:
    begin_s = time.monotonic()
    if arguments.out is None:
        arguments.out = Path("out") / arguments.scenario.stem
    _plan(arguments)
    out = arguments.out.absolute()
    windows = json.loads((out / PLAN).read_bytes())["windows"]
    with cluster.open_cluster(arguments.workers, arguments.scheduler) as where:
        if not (out / JOURNAL).exists():
            total = sum(len(window["parts"]) for window in windows)
            with Progress("parts", total, "parts") as progress:
                _dig(where, out, windows, progress)
        _perform_all(where, [Task(("resume", str(out)), out / PARTS)])
    shutil.rmtree(out / PARTS, ignore_errors=True)
    summary = json.loads((out / "summary.json").read_bytes())
    print(f"{summary['updates']} updates merged in {time.monotonic() - begin_s:.1f} s: {out}, "
          f"cut {summary['volume_m3']['cut']:.6g} m³, state_hash {summary['state_hash']}")
    return 0


def _plan(arguments: argparse.Namespace) -> None:
    """Says what it comes to. Raises InputError with the program's words."""
    command = [_program(), "part", "plan", f"--out={arguments.out}", f"--parts={arguments.parts}"]
    for name in ("voxel", "updates", "memory"):
        if getattr(arguments, name) is not None:
            command.append(f"--{name}={getattr(arguments, name)!r}")
    command += ["--", str(arguments.scenario)]  # its name may begin with a dash
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = done.stderr.strip().splitlines() or [f"soilvdb ended with {done.returncode}"]
    last = lines[-1].removeprefix("soilvdb: ")
    if done.returncode == 2:
        raise InputError(last)
    if done.returncode:
        raise RuntimeError(last)
    print(done.stderr, end="", file=sys.stderr)  # warnings
    print(done.stdout, end="", flush=True)


def _dig(where: cluster.Cluster, out: Path, windows: Sequence[dict[str, Any]],
         progress: Progress) -> None:
    done = 0
    for w, window in enumerate(windows):
        if not (out / PARTS / f"window_{w + 1}.vdb").exists():
            # The largest first, so that none is left over at the end.
            order = sorted((-int(part["updates"]), p) for p, part in enumerate(window["parts"]))
            tasks = [Task(("part", "dig", str(out), "--window", str(w), "--part", str(p),
                           "--threads", "1"), out / PARTS / f"{w}_{p}") for _, p in order]
            _perform_all(where, tasks, progress, done)
            _perform_all(where, [Task(("part", "merge", str(out), "--window", str(w)),
                                      out / PARTS)])
        done += len(window["parts"])
        progress.update(done)


def _perform_all(where: cluster.Cluster, tasks: Sequence[Task], progress: Progress | None = None,
                 before: int = 0) -> None:
    """Raises RuntimeError with what the first that failed said, once all were tried."""
    failed: list[str] = []
    for n, outcome in enumerate(cluster.run_tasks(where, perform, tasks), 1):
        error = outcome.error
        if error is not None:
            failed.append(error.message if isinstance(error, JobError) else
                          f"{type(error).__name__}: {error}")
        if progress:
            progress.update(before + n)
    if failed:
        raise RuntimeError(f"{failed[0]}; once that is mended the same command goes on")
