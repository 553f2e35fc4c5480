# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Errors of refused states."""

from __future__ import annotations


class _Refused(ValueError):
    def __init__(self, message: str = "", machine: str | None = None, reason: str = "") -> None:
        super().__init__(message)
        self.machine = machine
        self.reason = reason or message


class StateError(_Refused):
    """A state was refused: it is invalid, or no machine has it. Nothing has moved.

    machine: name of the machine, or None. reason: the message without the machine.
    """


class NoGroundError(_Refused):
    """The bucket would reach ground where the terrain has no height. Nothing has moved.

    machine: name of the machine, or None. reason: the message without the machine.
    """


for _error in (StateError, NoGroundError):
    _error.__module__ = "soilvdb"
