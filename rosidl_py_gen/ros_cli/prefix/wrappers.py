"""Executable files of a prefix: programs that call a function, or run a Python script, with this Python."""

from __future__ import annotations

import os
import sys
from pathlib import Path

_MAX_SHEBANG = 120
"""Maximum length of the first line of a program; Linux reads 127 bytes before 5.1."""
_MARK = "# Written by rosidl-py prefix"


def is_python_program(file: Path) -> bool:
    """Return True for a script that starts with the name of Python, and for an executable file ``.py``."""
    if not file.is_file():  # opening a pipe would wait for its writer
        return False
    with file.open("rb") as opened:
        line = opened.readline(200)
    return (line.startswith(b"#!") and b"python" in line) or (file.suffix == ".py" and os.access(file, os.X_OK))


def of_function(module: str, function: str) -> bytes:
    """Return a program that ends with the result of a function; dots in its name are attributes."""
    return f"""{_shebang()}
{_MARK}.
import sys

from {module} import {function.partition(".")[0]}

if __name__ == "__main__":
    sys.exit({function}())
""".encode()


def of_file(file: Path) -> bytes:
    """Return a program that runs a script in its folder; importing it imports the script."""
    return f"""{_shebang()}
{_MARK}: runs the script below.
import sys

__file__ = {str(file)!a}
sys.path.insert(0, {str(file.parent)!a})
with open(__file__, "rb") as _script:
    _code = compile(_script.read(), __file__, "exec", dont_inherit=True)
exec(_code)
""".encode()


def _shebang() -> str:
    """Return the first lines of a program; ``sh`` starts a Python whose path is long or has spaces."""
    line = f"#!{sys.executable}"
    if len(os.fsencode(line)) <= _MAX_SHEBANG and not any(map(str.isspace, line)) and line.isascii():
        return line
    quoted = sys.executable.replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$").replace("`", "\\`")
    return f"""#!/bin/sh\n'''exec' "{quoted}" "$0" "$@"\n' '''"""
