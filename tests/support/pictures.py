"""Pictures of the documentation, written by the tests that verify them: WRITE_PICTURES=docs/images pytest ..."""

from __future__ import annotations

import os
from pathlib import Path


def write_picture(name: str, content: bytes) -> None:
    """Check that this is a PNG; write it to the folder in WRITE_PICTURES, if that is set."""
    assert content.startswith(b"\x89PNG") and len(content) > 5000
    if folder := os.environ.get("WRITE_PICTURES"):
        Path(folder, name).write_bytes(content)
