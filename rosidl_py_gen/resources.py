"""Where the files that are not Python live: the grammar beside the code, templates and interfaces in wheel or checkout.

In a wheel `templates/` and `interfaces/` travel inside the package; in a checkout (editable install) they are at the
top.
"""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def grammar_text(name: str) -> str:
    """The text of a grammar file in `spec/`."""
    return (_PACKAGE / "spec" / name).read_text(encoding="utf-8")


def templates_dir() -> Path:
    """The folder of the jinja templates."""
    return _find("templates")


def compiled_templates_dir() -> Path:
    """The folder of what jinja2 makes of them; only wheels have one."""
    return _PACKAGE / "compiled_templates"


def interfaces_dir() -> Path:
    """The folder of the bundled interface packages."""
    return _find("interfaces")


def _find(name: str) -> Path:
    inside = _PACKAGE / name
    return inside if inside.is_dir() else _PACKAGE.parent / name
