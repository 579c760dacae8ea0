"""``python tools/regenerate_golden.py``: write what the compiler makes of the odd cases into `tests/golden/generated`.

The interfaces in `tests/golden/interfaces` hold the cases that are easy to get wrong. Reviewing a change of the
templates means reading the difference that this program leaves; a test checks that nothing else is there. Bundled
dependencies are not kept.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import generate

GOLDEN = Path(__file__).resolve().parents[1] / "tests" / "golden"
PACKAGES = ("odd_msgs", "other_msgs")


def fresh(folder: Path) -> dict[str, str]:
    """Generate into an empty folder; relative path -> text of the packages that are kept."""
    generate(SearchPath.scan([GOLDEN / "interfaces"], ament=""), list(PACKAGES), folder)
    return texts(folder)


def texts(folder: Path) -> dict[str, str]:
    paths = sorted(
        path for package in PACKAGES for path in (folder / package).rglob("*") if path.suffix in (".py", ".typed")
    )
    return {path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def main() -> None:
    with tempfile.TemporaryDirectory() as temporary:
        wanted = fresh(Path(temporary))
    target = GOLDEN / "generated"
    before = texts(target)
    shutil.rmtree(target, ignore_errors=True)
    for name, text in wanted.items():
        path = target / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    changed = sorted(name for name in {*before, *wanted} if before.get(name) != wanted.get(name))
    print(*changed or ["nothing changed"], sep="\n")


if __name__ == "__main__":
    sys.exit(main())
