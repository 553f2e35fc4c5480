# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Arrays of other libraries as views of their memory."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt


class DLPack(Protocol):
    """An array of another library."""

    def __dlpack__(self, *given: Any, **named: Any) -> Any: ...


class _Memory:
    """Memory of an array that its library lets others write to, but NumPy takes as read-only."""

    def __init__(self, of: npt.NDArray[Any]) -> None:
        self._of = of
        interface = dict(of.__array_interface__)
        interface["data"] = (interface["data"][0], False)
        self.__array_interface__ = interface


def view_of(given: Any) -> npt.NDArray[Any] | None:
    """An array that shares memory with an object; None if none can."""
    try:
        return np.asarray(memoryview(given))
    except (TypeError, ValueError):
        pass
    if hasattr(given, "__array_interface__"):
        return np.asarray(given)
    if not hasattr(given, "__dlpack__"):
        return None
    try:
        shared = np.from_dlpack(given)
    except (BufferError, RuntimeError, TypeError, ValueError):
        return None
    if hasattr(given, "__array__"):  # says whether it may be written to
        own = np.asarray(given)
        same = own.__array_interface__["data"][0] == shared.__array_interface__["data"][0]
        return own if same else None
    return np.asarray(_Memory(shared))
