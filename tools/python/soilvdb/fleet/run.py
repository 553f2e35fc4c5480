# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""fleet run: the jobs of a manifest, each in a run folder of its own, and tables of them all."""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import InputError, cluster
from .jobs import Job, JobError, Result, failure_of, note_failure, result_of, run_job
from .manifest import read_manifest
from .progress import Progress
from .slurm import write_script
from .tables import write_tables


def add_parser(subparsers: Any) -> None:
    parser = subparsers.add_parser(
        "run", help="dig the jobs of a manifest", allow_abbrev=False,
        description="Digs the jobs of a manifest into folders in DIR, continues unfinished ones, "
                    "and writes DIR/results.csv and DIR/failed.csv.")
    parser.add_argument("manifest", metavar="JOBS.csv", type=Path,
                        help="columns job and scenario; voxel, updates, threads and memory "
                             "override. Default: 1 thread")
    parser.add_argument("--out", metavar="DIR", type=Path, required=True)
    where = cluster.add_options(parser)
    where.add_argument("--slurm", action="store_true",
                       help="write DIR/slurm.sh, which submits the jobs, instead of running them")
    where.add_argument("--gather", action="store_true",
                       help="only write the tables of the jobs so far")
    where.add_argument("--job", metavar="I", type=int,
                       help="only job I of the manifest, from 0, in this process, without tables")
    parser.set_defaults(main=main)


def main(arguments: argparse.Namespace) -> int:
    out: Path = arguments.out
    jobs = read_manifest(arguments.manifest, out)
    if arguments.job is not None and not 0 <= arguments.job < len(jobs):
        raise InputError(f"--job {arguments.job}: there are jobs 0 to {len(jobs) - 1}")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{out}: can't be made a folder: {error.strerror}; name another") from error
    if arguments.slurm:
        print(f"submit with: sh {write_script(out, arguments.manifest, jobs)} [OPTION OF SBATCH...]")
        return 0
    if arguments.job is not None:
        return _run_one(jobs[arguments.job])
    begin_s = time.monotonic()
    results: dict[str, Result] = {}
    failures: dict[str, JobError] = {}
    if arguments.gather:
        _gather(jobs, results, failures)
    else:
        _run(jobs, arguments, results, failures)
    write_tables(out, jobs, results, failures)
    print(f"{len(results)} of {len(jobs)} jobs done in {time.monotonic() - begin_s:.1f} s: "
          f"{out / 'results.csv'}")
    if not failures:
        return 0
    name, first = next(iter(failures.items()))
    print(f"soilvdb: without a result: {len(failures)} of {len(jobs)} jobs, see {out / 'failed.csv'}; "
          f"'{name}': {first.message}", file=sys.stderr)
    return 1


def _run(jobs: Sequence[Job], arguments: argparse.Namespace, results: dict[str, Result],
         failures: dict[str, JobError]) -> None:
    with cluster.open_cluster(arguments.workers, arguments.scheduler) as where, \
            Progress("jobs", len(jobs), "jobs") as progress:
        for outcome in cluster.run_tasks(where, run_job, jobs):
            name = jobs[outcome.index].name
            if outcome.value is not None:
                results[name] = outcome.value
            else:
                error = outcome.error
                failures[name] = error if isinstance(error, JobError) else JobError(
                    1, f"{type(error).__name__}: {error}")
            progress.update(len(results) + len(failures))


def _run_one(job: Job) -> int:
    try:
        run_job(job)
        return 0
    except JobError as error:
        print(f"soilvdb: {error.message}", file=sys.stderr)
        with contextlib.suppress(OSError, JobError):  # a full disk
            note_failure(job, error)
        return error.status if error.status == 2 else 1


def _gather(jobs: Sequence[Job], results: dict[str, Result],
            failures: dict[str, JobError]) -> None:
    for job in jobs:
        try:
            result = result_of(job)
            if result:
                results[job.name] = result
            else:
                failures[job.name] = failure_of(job)
        except JobError as error:
            failures[job.name] = error
