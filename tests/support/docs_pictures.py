"""Pictures of the documentation, which the tests that verify them write: ROSIDL_WRITE_DOCS_PICTURES=1 pytest FILE."""

from __future__ import annotations

import os

from support.folders import ROOT

IMAGES = ROOT / "docs" / "images"


def update_picture(name: str, data: bytes) -> None:
    """Write a picture of the documentation if the environment asks for it; it must exist."""
    if os.environ.get("ROSIDL_WRITE_DOCS_PICTURES"):
        (IMAGES / name).write_bytes(data)
    assert (IMAGES / name).is_file(), f"no picture {name}; set ROSIDL_WRITE_DOCS_PICTURES=1"
