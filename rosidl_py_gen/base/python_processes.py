"""Command lines of further Python processes."""

from __future__ import annotations

import sys


def python_command(statements: str, *arguments: str) -> list[str]:
    """Return the command line of a Python process that runs statements with the import path of this process.

    With ``-m``, and with ``-c`` alone, the process would import modules of the current folder first, which are not
    trusted. The arguments are in ``sys.argv[1:]``.
    """
    return [sys.executable, "-c", f"import sys; sys.path[:] = {sys.path!r}; {statements}", *arguments]
