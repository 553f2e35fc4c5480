# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Many runs, on this machine's cores or on a Dask cluster: python3 -m soilvdb.fleet --help."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Wrong input, in one line: where, what is wrong, what would be right. Exit status 2."""


def nearest(word: str, known: Iterable[str]) -> str:
    """The end of a message: the known word nearest to an unknown one, or all known words."""
    words = sorted(known)
    near = difflib.get_close_matches(word, words, n=1)
    return f"did you mean '{near[0]}'?" if near else "known are " + ", ".join(words)
