# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""A progress bar for tasks."""

from __future__ import annotations

import os
import shutil
import sys
import time


class Progress:
    """A bar with count, rate and time left, if stderr is a terminal."""

    def __init__(self, title: str, total: int, unit: str) -> None:
        self._title, self._total, self._unit = title, total, unit
        self._on = sys.stderr.isatty() and os.environ.get("TERM", "dumb") != "dumb"
        self._begin_s = time.monotonic()
        self._next_s = 0.0

    def __enter__(self) -> Progress:
        self.update(0)
        return self

    def __exit__(self, *_: object) -> None:
        if self._on:
            print("\r\033[K", end="", file=sys.stderr, flush=True)

    def update(self, done: int) -> None:
        now_s = time.monotonic()
        if not self._on or now_s < self._next_s:
            return
        self._next_s = now_s + 0.1
        columns = shutil.get_terminal_size().columns
        line = progress_line(self._title, done, self._total, self._unit, now_s - self._begin_s,
                             columns)
        print("\r\033[K" + line, end="", file=sys.stderr, flush=True)


def progress_line(title: str, done: int, total: int, unit: str, elapsed_s: float,
                  columns: int) -> str:
    rate = done / elapsed_s if elapsed_s > 0 else 0.0
    tail = f" {done}/{total} {unit}  {rate:.3g}/s"
    if 0 < done < total:
        tail += f"  {_clock((total - done) / rate)} left"
    bar = min(40, columns - len(title) - len(tail) - 4)
    if bar < 10:
        return tail[1:columns]
    full = bar * done // max(1, total)
    return f"{title} [{'#' * full}{'.' * (bar - full)}]{tail}"


def _clock(seconds: float) -> str:
    s = round(seconds)
    if s < 60:
        return f"{s} s"
    return f"{s // 60}:{s % 60:02}" if s < 3600 else f"{s // 3600}:{s // 60 % 60:02}:{s % 60:02}"
