"""Executable of a package or of a command line, and the program in a prefix that runs it."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

_RUN_FUNCTION = """from {module} import {first}

if __name__ == "__main__":
    sys.exit({function}())
"""
_RUN_FILE = """__file__ = {file!a}
sys.path.insert(0, {folder!a})
with open(__file__, "rb") as _script:
    _code = compile(_script.read(), __file__, "exec", dont_inherit=True)
exec(_code)
"""
_MAX_SHEBANG = 120
"""Maximum length of the first line of a program, which names the interpreter; Linux before 5.1 reads 127 bytes."""


@dataclass(frozen=True)
class Executable:
    """Python executable: a script, a module, or a function of a module.

    Attributes:
        name: name in its package; of a program that is run, `sys.argv[0]`.
        folder: first folder of `sys.path`.
        module: module that becomes `__main__` or has the function; None for a script that is not run as a module.
        function: function of a console script, with dots for attributes, or None.
        warning: text that is printed when the executable starts, or empty.
    """

    name: str
    folder: Path
    file: Path | None = None
    module: str | None = None
    function: str | None = None
    warning: str = ""

    @property
    def place(self) -> Path:
        """Path that determines the workspace of the executable: its script, or else its folder."""
        return self.folder if self.file is None else self.file.resolve()

    def program(self) -> bytes:
        """Return the text of a program that runs the script, or ends with the function's result, with this Python."""
        first = f"#!{sys.executable}"
        if len(os.fsencode(first)) > _MAX_SHEBANG or any(map(str.isspace, first)) or not first.isascii():
            quoted = sys.executable.replace("\\", "\\\\").replace('"', '\\"').replace("$", "\\$").replace("`", "\\`")
            first = f"""#!/bin/sh\n'''exec' "{quoted}" "$0" "$@"\n' '''"""  # sh starts Python, for which it is a text
        if self.file is not None:
            text = _RUN_FILE.format(file=str(self.file), folder=str(self.file.parent))
        else:
            name = str(self.function)
            text = _RUN_FUNCTION.format(module=self.module, first=name.partition(".")[0], function=name)
        if self.warning:
            text = f"print({'warning: ' + self.warning!a}, file=sys.stderr)\n{text}"
        return os.fsencode(f"{first}\n# Written by rosidl-py prefix.\nimport sys\n\n{text}")
