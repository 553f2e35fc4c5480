# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A Slurm script that digs the jobs of a manifest, one array index per job."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from .jobs import Job

ARRAY = 1000  # Slurm's MaxArraySize is 1001 where nobody set it


def write_script(out: Path, manifest: Path, jobs: Sequence[Job]) -> Path:
    """Writes DIR/slurm.sh. Raises OSError. @return its path"""
    folder = Path(os.path.abspath(out))
    (folder / "slurm").mkdir(exist_ok=True)
    command = shlex.join([sys.executable, "-m", "soilvdb.fleet", "run", os.path.abspath(manifest),
                          "--out", str(folder)])
    array = shlex.join(["sbatch", "--parsable", "--job-name=soilvdb", "--requeue",
                        f"--cpus-per-task={max(job.threads or 1 for job in jobs)}"])
    logs = str(folder / "slurm").replace("%", "%%")  # of which sbatch makes numbers and names
    log = shlex.quote(f"--output={logs}/%A_%a.log")
    lines = ["#!/bin/sh",
             f"# Submits {len(jobs)} jobs, and what writes their tables once all have ended.",
             "# Arguments go to sbatch for each job: --time=2:00:00 --mem=4G --partition=NAME",
             "set -eu"]
    ids = []
    for first in range(0, len(jobs), ARRAY):
        last = min(ARRAY, len(jobs) - first) - 1
        wrap = f"exec {command} --job $(({first} + SLURM_ARRAY_TASK_ID))"
        ids.append(f"id{first}")
        lines.append(f'id{first}=$({array} {log} --array=0-{last} "$@" --wrap {shlex.quote(wrap)})')
    after = ":".join(f"${{{name}%%;*}}" for name in ids)  # of a federation it is ID;CLUSTER
    gather = shlex.join(["sbatch", "--job-name=soilvdb-tables",
                         f"--output={logs}/tables.log"])
    lines.append(f'{gather} --dependency="afterany:{after}" '
                 f"--wrap {shlex.quote(f'exec {command} --gather')}")
    script = folder / "slurm.sh"
    script.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return script
