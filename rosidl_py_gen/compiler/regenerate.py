"""``python -m rosidl_py_gen.compiler.regenerate [--check]``: generate the committed `rosidl_py_gen/msgs`."""

from __future__ import annotations

import sys
from pathlib import Path

import rosidl_py_gen
from rosidl_py_gen.compiler.generate import regenerate_msgs


def main() -> None:
    """Generate the files of `rosidl_py_gen/msgs`; with `--check`, write none and exit with 1 if a file would change."""
    dry = "--check" in sys.argv[1:]
    folder = Path(rosidl_py_gen.__file__).parent / "msgs"
    changes = regenerate_msgs(folder, dry=dry)
    for name in (*changes.written, *changes.removed):
        print(name)
    sys.exit(1 if dry and (changes.written or changes.removed) else 0)


if __name__ == "__main__":
    main()
