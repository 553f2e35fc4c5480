# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The whole command `soilvdb run`, for Python."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any


def _program() -> str:
    beside = Path(__file__).resolve().parents[2] / "soilvdb"  # where it was built
    found = str(beside) if beside.is_file() else shutil.which("soilvdb")
    if found is None:
        raise RuntimeError("the program soilvdb is not on the PATH; the package soilvdb has it")
    return found


def run(scenario: str | os.PathLike[str], out: str | os.PathLike[str], *,
        voxel: float | None = None, threads: int | None = None, updates: int | None = None,
        memory: int | None = None, mesh: bool = True, snapshots: bool = True) -> dict[str, Any]:
    """Runs a scenario into the folder `out` as `soilvdb run` does, and returns its summary.json.

    voxel: m, in place of the scenario's. threads: default: one per core. updates: number for each
    machine, default: one per row. memory: MB for the ground. Raises ValueError with the program's
    message for wrong input (nothing is written then), and RuntimeError for other failures. After a
    KeyboardInterrupt `soilvdb resume` can continue the run.
    """
    command = [_program(), "run", os.fspath(scenario), "--out", os.fspath(out)]
    for name, value in (("voxel", voxel), ("threads", threads), ("updates", updates),
                        ("memory", memory)):
        if value is not None:
            command += [f"--{name}", str(value)]
    if not mesh:
        command.append("--no-mesh")
    if not snapshots:
        command.append("--no-snapshots")
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        lines = done.stderr.strip().splitlines() or [f"soilvdb ended with {done.returncode}"]
        kind = ValueError if done.returncode == 2 else RuntimeError
        raise kind(lines[-1].removeprefix("soilvdb: "))
    summary: dict[str, Any] = json.loads((Path(out) / "summary.json").read_text())
    return summary
