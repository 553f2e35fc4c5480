# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A job: a scenario in its own run folder, dug by the program in its own process.

Beside the program's files a job's folder holds `job.json`: the job's inputs and, once the program
has succeeded, the digest of its summary. A summary alone is no proof, because a stopped run also
writes one. A finished job is not repeated if its files were deleted, for example to save disk
space; `soilvdb resume` restores them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import hashlib
import json
import os
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from .._run import _program

RECORD, LOCK, SUMMARY, JOURNAL = "job.json", "job.lock", "summary.json", "journal"


class JobError(Exception):
    """A job without a result. status: the program's exit status, or 128 + the signal's number."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(status, message)
        self.status, self.message = status, message


@dataclasses.dataclass(frozen=True)
class Job:
    """One row of a manifest. Paths are absolute, because workers run elsewhere. None: the option's
    default."""

    name: str
    listed: str  # the scenario as the manifest has it
    scenario: Path
    folder: Path
    voxel: float | None = None
    updates: int | None = None
    threads: int | None = None
    memory: int | None = None


@dataclasses.dataclass(frozen=True)
class Result:
    """summary.json, and the host that made it."""

    summary: dict[str, Any]
    host: str


def run_job(job: Job) -> Result:
    """Digs a job to its end, or continues it, or returns the result of a finished job.

    Attempts at the same job wait for one another, also for a program whose worker was killed. The
    program ends with the calling thread. Raises JobError.
    """
    try:
        job.folder.mkdir(parents=True, exist_ok=True)
        with locked(job.folder) as lock:
            done = result_of(job)
            if done:
                return done
            made_of = _made_of(job)
            _write_record(job, {"made_of": made_of})
            _dig(job, lock)
            text = (job.folder / SUMMARY).read_bytes()
            host = socket.gethostname()
            _write_record(job, {"made_of": made_of, "host": host,
                                "summary_sha256": hashlib.sha256(text).hexdigest()})
            return Result(json.loads(text), host)
    except (OSError, RuntimeError) as error:
        raise JobError(1, str(error)) from error


def result_of(job: Job) -> Result | None:
    """The result of a finished job; None for an unfinished one. Raises JobError if the folder holds
    another job."""
    record = _read_record(job)
    if not (job.folder / JOURNAL).exists():
        return None
    if record is None:
        raise JobError(2, f"{job.folder}: holds a run that belongs to no job; remove it or give "
                          "another --out")
    if record["made_of"] != _made_of(job):
        raise JobError(2, f"{job.folder}: holds another job, with another scenario, voxel or "
                          "updates; remove it or give another --out")
    try:
        text = (job.folder / SUMMARY).read_bytes()
    except FileNotFoundError:
        return None
    if hashlib.sha256(text).hexdigest() != record.get("summary_sha256"):
        return None
    return Result(json.loads(text), record["host"])


def note_failure(job: Job, error: JobError) -> None:
    """Stores a failure for failure_of in another process; a finished job stays finished. Raises
    OSError, JobError."""
    if result_of(job) is None:
        _write_record(job, {"made_of": _made_of(job), "status": error.status,
                            "message": error.message})


def failure_of(job: Job) -> JobError:
    """Why a job is unfinished, by its folder. May also raise JobError."""
    record = _read_record(job) or {}
    return JobError(record.get("status", 1), record.get("message", "isn't finished"))


def _read_record(job: Job) -> dict[str, Any] | None:
    try:
        record = json.loads((job.folder / RECORD).read_bytes())
    except FileNotFoundError:
        return None
    except ValueError:
        record = None
    if not isinstance(record, dict) or "made_of" not in record:
        raise JobError(1, f"{job.folder / RECORD}: is damaged; remove the folder")
    return record


def _write_record(job: Job, record: dict[str, Any]) -> None:
    """Writes completely or not at all, even if the process dies. Raises OSError."""
    beside = job.folder / f".{RECORD}.tmp"
    with open(beside, "w", encoding="utf-8") as file:
        json.dump(record, file)
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, job.folder / RECORD)


def _made_of(job: Job) -> dict[str, Any]:
    """The inputs that the result depends on, without threads and memory."""
    return {"scenario": os.path.relpath(job.scenario, job.folder),
            "scenario_sha256": hashlib.sha256(job.scenario.read_bytes()).hexdigest(),
            "voxel": job.voxel, "updates": job.updates}


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[int]:
    """The lock belongs to the file: the program inherits it, and may outlive this process
    briefly."""
    file = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        with contextlib.suppress(OSError):  # file systems without locks; the program has its own
            fcntl.flock(file, fcntl.LOCK_EX)
        yield file
    finally:
        os.close(file)


def _dig(job: Job, lock: int) -> None:
    run_program(lambda: _command(job), lock)


def run_program(command: Callable[[], list[str]], lock: int) -> None:
    """Runs the program to its end, again if it was killed. Raises JobError.

    command: called before each attempt. lock: of locked(); the program inherits it.
    """
    for last in (False, True):
        # setpriv ends the program even if the worker is killed.
        with subprocess.Popen(["setpriv", "--pdeathsig", "KILL", *command()],
                              stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                              stderr=subprocess.PIPE, pass_fds=(lock,)) as process:
            said = process.communicate()[1].decode(errors="replace").strip().splitlines()
        status = process.returncode
        if status == 0:
            return
        if status > 0:
            raise JobError(status, said[-1].removeprefix("soilvdb: ") if said else
                           f"soilvdb ended with {status} without a message")
        if last:
            raise JobError(128 - status, "the program was killed twice by "
                                         f"{signal.Signals(-status).name}; does the memory suffice?")


def _command(job: Job) -> list[str]:
    if (job.folder / JOURNAL).exists():
        return [_program(), "resume", str(job.folder), *_option("memory", job.memory)]
    return [_program(), "run", str(job.scenario), "--out", str(job.folder),
            *_option("voxel", job.voxel), *_option("updates", job.updates),
            *_option("threads", job.threads or 1), *_option("memory", job.memory)]


def _option(name: str, value: float | None) -> list[str]:
    return [] if value is None else [f"--{name}", repr(value)]
