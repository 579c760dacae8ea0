"""Where the files that are not Python live: the grammar beside the code, interfaces in wheel or checkout.

In a wheel `interfaces/` travels inside the package; in a checkout (editable install) it is at the top.
"""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def grammar_text(name: str) -> str:
    """The text of a grammar file in `spec/`."""
    return (_PACKAGE / "spec" / name).read_text(encoding="utf-8")


def interfaces_dir() -> Path:
    """The folder of the bundled interface packages."""
    inside = _PACKAGE / "interfaces"
    return inside if inside.is_dir() else _PACKAGE.parent / "interfaces"
