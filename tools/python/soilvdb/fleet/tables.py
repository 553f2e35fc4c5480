# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""The tables of many jobs: results.csv and failed.csv."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .jobs import Job, JobError, Result

# Columns that vary between runs come last, so that the others can be compared.
VARYING = ("update_us.", "wall_s.", "memory_bytes.")
RESULTS, FAILED = "results.csv", "failed.csv"
NO_FIGURES = ("soilvdb", "scenario", "files")  # the manifest's scenario is in the table


def figures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """The numbers of a summary by path: volume_m3.cut, machines.digger.cut_m3."""
    return dict(_flat("", {k: v for k, v in summary.items() if k not in NO_FIGURES}))


def _flat(path: str, value: Any) -> Iterable[tuple[str, Any]]:
    if isinstance(value, list):
        value = {each["name"]: {k: v for k, v in each.items() if k != "name"} for each in value}
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(f"{path}.{key}" if path else key, inner)
    else:
        yield path, value


def write_tables(out: Path, jobs: Sequence[Job], results: Mapping[str, Result],
                 failures: Mapping[str, JobError]) -> None:
    """Writes both tables, with rows in the order of the jobs. Raises OSError."""
    rows = []
    columns: dict[str, None] = {}
    for job in jobs:
        if job.name not in results:
            continue
        result = results[job.name]
        row = figures(result.summary)
        columns.update(dict.fromkeys(row))
        rows.append({"job": job.name, "scenario": job.listed, "host": result.host,
                     **row})
    varying = [name for name in columns if name.startswith(VARYING)]
    header = ["job", "scenario", *(name for name in columns if name not in varying), *varying,
              "host"]
    _write(out / RESULTS, header, rows)
    _write(out / FAILED, ["job", "exit_status", "message"],
           [{"job": job.name, "exit_status": failures[job.name].status,
             "message": failures[job.name].message} for job in jobs if job.name in failures])


def beside(name: str) -> str:
    """The name of an unfinished table."""
    return f".{name}.tmp"


def _write(file: Path, header: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> None:
    half_done = file.with_name(beside(file.name))
    # Messages may contain paths that are not valid text.
    with open(half_done, "w", encoding="utf-8", errors="backslashreplace", newline="") as text:
        table = csv.DictWriter(text, header, restval="", lineterminator="\n")
        table.writeheader()
        table.writerows(rows)
        text.flush()
        os.fsync(text.fileno())
    os.replace(half_done, file)
