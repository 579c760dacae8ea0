"""Command lines for starting other Python processes."""

from __future__ import annotations

import sys


def python_command(statements: str, *arguments: str) -> list[str]:
    """Return the command line of a Python process that runs the given statements with the import path of this process.

    The arguments are in ``sys.argv[1:]``. A process started with ``-m``, or with ``-c`` alone, would import modules of
    the current folder first, which are not trusted.
    """
    return [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {statements}", *arguments]
