"""Executable files of a prefix: programs that call a function, or run a Python script, with this Python."""

from __future__ import annotations

import os
import sys
from pathlib import Path

_MAX_SHEBANG = 120
"""Maximum length of the first line of a program; Linux reads 127 bytes before 5.1."""


def of_function(module: str | None, function: str | None) -> bytes:
    """Return a program that ends with the result of a function; dots in its name are attributes."""
    name = str(function)
    return _program(
        f"from {module} import {name.partition('.')[0]}\n\nif __name__ == '__main__':\n    sys.exit({name}())\n"
    )


def of_file(file: Path) -> bytes:
    """Return a program that runs a script in its folder; importing it imports the script."""
    return _program(
        f"""__file__ = {str(file)!a}
sys.path.insert(0, {str(file.parent)!a})
with open(__file__, "rb") as _script:
    _code = compile(_script.read(), __file__, "exec", dont_inherit=True)
exec(_code)
"""
    )


def _program(text: str) -> bytes:
    """Return a Python program; ``sh`` starts a Python whose path is long or has spaces."""
    first = f"#!{sys.executable}"
    if len(os.fsencode(first)) > _MAX_SHEBANG or any(map(str.isspace, first)) or not first.isascii():
        quoted = sys.executable.replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$").replace("`", "\\`")
        first = f"""#!/bin/sh\n'''exec' "{quoted}" "$0" "$@"\n' '''"""
    return os.fsencode(f"{first}\n# Written by rosidl-py prefix.\nimport sys\n\n{text}")
