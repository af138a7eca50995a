"""The command `clvox`: every verb of the library that reads a file and writes one.

`arguments` says what may be asked for, `commands` and `demo` do it, `console` speaks and `files`
sees to it that a file is written whole or not at all.  Nothing heavy is loaded before the
arguments are known to be right.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from typing import TYPE_CHECKING

from clvox.cli.arguments import parse
from clvox.cli.console import Console
from clvox.errors import ClvoxError

if TYPE_CHECKING:
    from clvox.cli.commands import Command

__all__ = ["main"]

FAILED = 1
INTERRUPTED = 130


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments behind the command's name; by default those of this process.

    Returns
    -------
    int
        0, all is well; 1, the files, the mesh or the device stand in the way, as one sentence on
        the standard error says; 130, interrupted.  `clvox doctor` ends with 1 if something failed
        and with 3 if there is no device.

    Raises
    ------
    SystemExit
        With status 2 after a wrong argument, with 0 after ``--help`` and ``--version``.
    """
    options = parse(argv)
    console = Console(as_json=options.json, quiet=options.quiet)
    try:
        _command(options.command)(options, console)
        console.close()
    except KeyboardInterrupt:
        console.complain("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        # Whoever read the output has seen enough; the interpreter would flush it once more.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except (ClvoxError, OSError, MemoryError) as error:
        if options.debug:
            traceback.print_exc()
        console.complain(f"error: {_sentence(error)}")
        return FAILED
    return console.status


def _command(name: str) -> Command:
    if name == "demo":
        from clvox.cli.demo import demo

        return demo
    if name == "dexelize":
        from clvox.cli.dexelize import dexelize

        return dexelize
    from clvox.cli import commands

    return commands.COMMANDS[name]


def _sentence(error: BaseException) -> str:
    """What went wrong, without Python's and the system's numbers."""
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, MemoryError) and not isinstance(error, ClvoxError):
        return f"this computer has no room for the work: {error}".rstrip(": ")
    return str(error)
