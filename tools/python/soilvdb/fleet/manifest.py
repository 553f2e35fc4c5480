# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest of many jobs: a CSV file with the columns job, scenario, and some that override."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from . import InputError, nearest
from .jobs import Job
from .tables import FAILED, RESULTS, beside

# Files beside the jobs' folders.
TABLES = (RESULTS, FAILED, beside(RESULTS), beside(FAILED), "slurm.sh", "slurm")
NAME_BYTES = 255  # longest name of a file

# Ranges as in the program's options.
RANGES: dict[str, tuple[Callable[[str], float], float, float, str]] = {
    "voxel": (float, 1e-4, 100, "a voxel size from 0.0001 to 100 m"),
    "updates": (int, 1, 10**8, "a whole number from 1 to 100000000"),
    "threads": (int, 1, 1024, "a whole number from 1 to 1024"),
    "memory": (int, 16, 10**7, "a whole number of MB from 16 to 10000000"),
}
COLUMNS = ("job", "scenario", *RANGES)


def read_manifest(file: Path, out: Path) -> list[Job]:
    """The jobs of a manifest, in its order. Scenarios are relative to the manifest's folder.

    out: parent of the jobs' folders. Raises InputError with FILE:LINE.
    """
    jobs: list[Job] = []
    lines: dict[str, int] = {}
    try:
        with open(file, encoding="utf-8-sig", newline="") as text:
            rows = csv.reader(text, strict=True, skipinitialspace=True)
            header: list[str] = []
            try:
                for row in rows:
                    cells = [cell.strip() for cell in row]
                    if not any(cells):
                        continue
                    at = f"{file}:{rows.line_num}"
                    if not header:
                        header = _header(cells, at)
                        continue
                    job = _job(cells, header, file, out, at)
                    if job.name in lines:
                        raise InputError(f"{at}: the job '{job.name}' is in line "
                                         f"{lines[job.name]} already; each needs a name of its own")
                    lines[job.name] = rows.line_num
                    jobs.append(job)
            except csv.Error as error:
                raise InputError(f"{file}:{rows.line_num}: {error}; it must be a CSV file") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: is not UTF-8 text; it must be a CSV file") from error
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}; name a CSV file of jobs") from error
    if not jobs:
        raise InputError(f"{file}: has no jobs; a line with job,scenario and one for each job "
                         "are right")
    return jobs


def _header(cells: list[str], at: str) -> list[str]:
    for name in cells:
        if name not in COLUMNS:
            raise InputError(f"{at}: unknown column '{name}'; {nearest(name, COLUMNS)}")
        if cells.count(name) > 1:
            raise InputError(f"{at}: the column '{name}' is there twice; leave one out")
    for name in ("job", "scenario"):
        if name not in cells:
            raise InputError(f"{at}: the column '{name}' is missing; job and scenario are needed")
    return cells


def _job(cells: list[str], header: list[str], file: Path, out: Path, at: str) -> Job:
    if len(cells) != len(header):
        raise InputError(f"{at}: {len(cells)} cells; there are {len(header)} columns")
    row = dict(zip(header, cells))
    name = row["job"]
    if (name in ("", ".", "..") or "/" in name or not name.isprintable()
            or len(os.fsencode(name)) > NAME_BYTES):
        raise InputError(f"{at}: the job '{name}' can't be the name of a folder; letters, digits, "
                         "_ and - are right")
    if name in TABLES:
        raise InputError(f"{at}: '{name}' is the name of a table beside the jobs; "
                         "give the job another name")
    scenario = Path(os.path.abspath(file.parent / row["scenario"]))
    if not _is_file(scenario):
        raise InputError(f"{at}: there is no scenario '{row['scenario']}' in {file.parent}; "
                         "give its path relative to that folder")
    numbers: dict[str, Any] = {key: _number(key, row.get(key, ""), at) for key in RANGES}
    return Job(name, row["scenario"], scenario, Path(os.path.abspath(out)) / name, **numbers)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # too long a name, or a folder that may not be read
        return False


def _number(key: str, text: str, at: str) -> float | None:
    if not text:
        return None
    kind, least, most, right = RANGES[key]
    try:
        value = kind(text)
    except ValueError:
        value = float("nan")
    if not least <= value <= most or "_" in text:
        raise InputError(f"{at}: {key} is '{text}'; it must be {right}, or empty")
    return value
