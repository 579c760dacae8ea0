"""Display of this machine for windows."""

from __future__ import annotations

import os
import sys


def has_display() -> bool:
    """Return True if a window can be opened on this machine."""
    if sys.platform in ("darwin", "win32"):
        return "SSH_CONNECTION" not in os.environ
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
