"""Parser of TOML in untrusted files, in time that is linear in their size."""

from __future__ import annotations

import sys
from typing import Any

_MAX_DOTS = 300
"""Maximum number of dots in a line of TOML: the time of `tomllib` is quadratic in the number of parts of a key."""


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text; raises ValueError for invalid or too deeply nested text."""
    if sys.version_info >= (3, 11):
        import tomllib
    else:
        import tomli as tomllib
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > _MAX_DOTS:
            raise ValueError(f"line {number} has more than {_MAX_DOTS} dots")
    try:
        data: dict[str, Any] = tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    return data
