# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""python3 -m soilvdb.fleet: the command line, and what becomes of errors."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import io
import sys
from typing import NoReturn

from . import InputError

COMMANDS = ("run", "uncertainty")  # modules beside this one


class Parser(argparse.ArgumentParser):
    """Reports a wrong command line in one line."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; {self.prog} --help says what is right")


def command_line() -> Parser:
    parser = Parser(prog="python3 -m soilvdb.fleet", allow_abbrev=False, description=__doc__,
                    epilog="Exit status: 0 all done; 2 the input or the command line is wrong, "
                           "nothing was written; 1 anything else.")
    parser.description = "Many runs, on this machine's cores or on a Dask cluster."
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name in COMMANDS:
        if importlib.util.find_spec(f"{__package__}.{name}"):
            importlib.import_module(f"{__package__}.{name}").add_parser(commands)
    return parser


def _printable(text: str) -> str:
    """On one line, whatever characters a table's cell or a path has."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def main(arguments: list[str]) -> int:
    try:
        chosen = command_line().parse_args(arguments)
        status: int = chosen.main(chosen)
        return status
    except InputError as error:
        print(f"soilvdb: {_printable(str(error))}", file=sys.stderr)
        return 2
    except (OSError, RuntimeError) as error:
        print(f"soilvdb: {_printable(str(error))}", file=sys.stderr)
    except KeyboardInterrupt:
        print("soilvdb: stopped; the same command goes on", file=sys.stderr)
    return 1


if __name__ == "__main__":  # workers import this module by another name
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # paths may be no text
    sys.exit(main(sys.argv[1:]))
