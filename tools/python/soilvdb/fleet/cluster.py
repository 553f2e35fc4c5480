# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Tasks on a Dask cluster: an existing one, or one of this machine's cores.

    with open_cluster(arguments.workers, arguments.scheduler) as cluster:
        for outcome in run_tasks(cluster, function, tasks):
            if outcome.error is None:
                results[outcome.index] = outcome.value

The tasks of a lost worker are repeated by another, and all unfinished tasks after a restart of the
scheduler. `function` may thus be called several times for a task, even at once; each task has one
outcome.
"""

from __future__ import annotations

import argparse
import asyncio
import collections
import contextlib
import dataclasses
import importlib
import logging
import os
import queue
import re
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from typing import Any, Generic, TypeVar

T = TypeVar("T")
R = TypeVar("R")

ATTEMPTS = 3  # at a failing task, each on another host if possible
PAUSE_S = 3.0  # before repeated attempts: a host may join, a disk may be cleared
DEATHS = 10  # of three workers each, after which the task is blamed
PATIENCE_S = 600.0  # with an unreachable scheduler
QUIET_S = 30.0  # without workers until a warning
CLOSE_S = 30.0  # for a client to end; on a busy host its own coroutines take seconds


@dataclasses.dataclass(frozen=True)
class Outcome(Generic[R]):
    """The result of a task: its value, or the exception of the last attempt."""

    index: int
    value: R | None
    error: BaseException | None


def add_options(parser: argparse.ArgumentParser) -> Any:
    """Adds --workers and --scheduler for open_cluster. @return the group that excludes them"""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=_count, metavar="N",
                       help="processes on this machine; default: one per core")
    where.add_argument("--scheduler", type=_address, metavar="ADDRESS",
                       help="of an existing Dask cluster, such as tcp://host:8786")
    return where


def _count(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1 to 1024")
    return int(text)


def _address(text: str) -> str:
    match = re.fullmatch(r"((tcp|tls|wss?)://)?[^\s/]+:([0-9]{1,5})", text)
    if not match or not 1 <= int(match[3]) <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not an address such as tcp://host:8786")
    if match[2] in ("tls", "wss"):
        # Without certificates Dask's client prints a traceback and hangs for a while.
        if _dask().Security().get_connection_args("client")["ssl_context"] is None:
            raise argparse.ArgumentTypeError(f"'{text}' needs certificates, which Dask's "
                                             "configuration has under distributed.comm.tls")
    return text


def _dask() -> Any:
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise RuntimeError("Dask is missing: apt install python3-distributed, or "
                           "pip install distributed") from error


class _Loop:
    """An event loop in a thread of its own, for one client. A client that is closed while it
    searches its scheduler may leave coroutines behind, which Python would report. They end with the
    loop."""

    def __init__(self) -> None:
        self._started = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), daemon=True)
        self._thread.start()
        self._started.wait()

    async def _main(self) -> None:
        self.tornado = importlib.import_module("tornado.ioloop").IOLoop.current()
        self._asyncio = asyncio.get_running_loop()
        self._ended = asyncio.Event()
        self._started.set()
        await self._ended.wait()

    def end(self) -> None:
        """Cancels all running tasks and waits for their end."""
        with contextlib.suppress(RuntimeError):  # it has ended
            self._asyncio.call_soon_threadsafe(self._ended.set)
        self._thread.join(CLOSE_S)


class Cluster:
    """A client of a scheduler, replaced when the scheduler was restarted. For one thread."""

    def __init__(self, address: str) -> None:
        self._address = address
        self.client: Any = None
        self._loop: _Loop | None = None
        self.connect(patience_s=0.0)

    def connect(self, patience_s: float = PATIENCE_S) -> None:
        """Connects anew. Raises RuntimeError if no scheduler answers in this time."""
        self.close()
        end = time.monotonic() + patience_s
        while True:
            try:
                self._loop = _Loop()
                self.client = _dask().Client(self._address, timeout=10, set_as_default=False,
                                             loop=self._loop.tornado)
                return
            except OSError as error:
                self.close()
                if time.monotonic() >= end:
                    raise RuntimeError(f"{self._address}: no Dask scheduler answers") from error
            time.sleep(0.2)

    def close(self) -> None:
        if self.client is not None:
            with contextlib.suppress(Exception):
                self.client.close(timeout=CLOSE_S)
            self.client.status = "closed"  # or it tries once more when Python drops it
        self.client = None
        if self._loop is not None:
            self._loop.end()
        self._loop = None


@contextlib.contextmanager
def open_cluster(workers: int | None, scheduler: str | None) -> Iterator[Cluster]:
    """A cluster of a scheduler, or of a number of processes of this machine, which end with it.

    workers: default one per core. Raises RuntimeError without Dask or without a scheduler.
    """
    dask = _dask()
    # Work continues after each loss; thousands of messages would hide the cause.
    logging.disable(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="soilvdb-"))
            local = stack.enter_context(dask.LocalCluster(
                n_workers=workers or os.cpu_count(), threads_per_worker=1, processes=True,
                # Without addresses their HTTP servers listen on all interfaces, and collide on this
                # host.
                dashboard_address=None, scheduler_kwargs={"dashboard_address": "127.0.0.1:0"},
                worker_dashboard_address="127.0.0.1:0", memory_limit=0, local_directory=folder,
                silence_logs=logging.CRITICAL))
            scheduler = str(local.scheduler_address)
        cluster = Cluster(scheduler)
        stack.callback(cluster.close)
        yield cluster


def _call(function: Callable[[T], R], task: T) -> tuple[str, R | None, BaseException | None]:
    """Runs on a worker: the host's address, and the task's outcome."""
    host = _host(_dask().get_worker().address)
    try:
        return host, function(task), None
    except Exception as error:  # pylint: disable=broad-except  # all of it is the task's outcome
        return host, None, error


def _host(address: str) -> str:
    return address.rpartition("/")[2].rpartition(":")[0]


@dataclasses.dataclass
class _Task:
    attempts: int = 0
    deaths: int = 0
    due_s: float = 0.0  # not before
    failed_on: set[str] = dataclasses.field(default_factory=set)
    tied_to: list[str] = dataclasses.field(default_factory=list)  # workers, where not any will do


class _Tasks(Generic[T, R]):
    """Waiting, submitted and finished tasks. At most twice as many tasks as threads are submitted,
    so that late workers get a share, and few are submitted again to a restarted scheduler."""

    def __init__(self, cluster: Cluster, function: Callable[[T], R], tasks: Sequence[T]) -> None:
        self._cluster, self._function, self._inputs = cluster, function, tasks
        self._tasks = [_Task() for _ in tasks]
        self._waiting = collections.deque(range(len(tasks)))
        self._futures: dict[int, Any] = {}
        self._events: queue.SimpleQueue[tuple[int, Any]] = queue.SimpleQueue()
        self._threads: dict[str, int] = {}  # of each worker
        self._asked_s = -1e9
        self._busy_s = time.monotonic()

    def outcomes(self) -> Iterator[Outcome[R]]:
        try:
            while self._waiting or self._futures:
                try:
                    self._submit()
                    index, future = self._events.get(timeout=1)
                except queue.Empty:
                    if self._cluster.client.status != "running":
                        self._lose_all()
                    continue
                except (asyncio.TimeoutError, OSError):  # of the scheduler
                    self._lose_all()
                    continue
                if self._futures.get(index) is not future:
                    continue  # from before a restart of the scheduler
                outcome = self._take(index, future)
                if outcome:
                    yield outcome
        finally:
            self._futures.clear()

    def _look(self, now_s: float) -> None:
        """Updates the list of workers, resubmits tasks tied to lost ones; warns without workers."""
        self._threads, self._asked_s = self._cluster.client.nthreads(), now_s
        if self._threads:
            self._busy_s = now_s
        elif now_s > self._busy_s + QUIET_S:
            print("soilvdb: warning: the scheduler has no workers; waiting for some",
                  file=sys.stderr)
            self._busy_s = float("inf")
        for index in list(self._futures):
            tied_to = self._tasks[index].tied_to
            if tied_to and not any(worker in self._threads for worker in tied_to):
                del self._futures[index]
                self._waiting.append(index)

    def _submit(self) -> None:
        client = self._cluster.client
        now = time.monotonic()
        if now > self._asked_s + 1:
            self._look(now)
        room = 2 * sum(self._threads.values()) - len(self._futures)
        for _ in range(len(self._waiting)):
            if room <= 0:
                return
            index = self._waiting.popleft()
            if now < self._tasks[index].due_s:
                self._waiting.append(index)
                continue
            room -= 1
            failed_on = self._tasks[index].failed_on
            others = [worker for worker in self._threads if _host(worker) not in failed_on]
            self._tasks[index].tied_to = others if failed_on else []
            future = client.submit(_call, self._function, self._inputs[index], pure=False,
                                   workers=self._tasks[index].tied_to or None)
            self._futures[index] = future
            future.add_done_callback(lambda done, at=index: self._events.put((at, done)))

    def _take(self, index: int, future: Any) -> Outcome[R] | None:
        """The outcome of a task, unless it is repeated."""
        task = self._tasks[index]
        try:
            host, value, error = future.result(timeout=60)
        except (asyncio.CancelledError, futures.CancelledError, asyncio.TimeoutError, OSError):
            # A lost scheduler makes clients cancel all their tasks.
            self._lose_all()
            return None
        except _dask().KilledWorker:
            task.deaths += 1
            host, value = "", None
            error = RuntimeError("the worker at it died, again and again")
            again = task.deaths < DEATHS
        except Exception as failure:  # pylint: disable=broad-except  # a worker without the module
            host, value, error = "", None, failure
            task.attempts += 1
            again = task.attempts < ATTEMPTS
        else:
            if error is None:
                del self._futures[index]
                return Outcome(index, value, None)
            task.attempts += 1
            task.failed_on.add(host)
            again = task.attempts < ATTEMPTS
        del self._futures[index]
        if not again:
            return Outcome(index, None, error)
        task.due_s = time.monotonic() + PAUSE_S
        self._waiting.append(index)
        return None

    def _lose_all(self) -> None:
        self._waiting.extendleft(sorted(self._futures, reverse=True))
        self._futures.clear()
        self._asked_s = -1e9
        self._cluster.connect()


def run_tasks(cluster: Cluster, function: Callable[[T], R],
              tasks: Sequence[T]) -> Iterator[Outcome[R]]:
    """Calls function(task) for each task on the cluster's workers, which must be able to import it.
    Yields one outcome per task, in the order of their ends.

    A failing task is tried three times, with pauses and on other hosts if possible. Raises
    RuntimeError if the scheduler is unreachable for ten minutes.
    """
    return _Tasks(cluster, function, tasks).outcomes()
