"""Puts our rclpy on sys.path, and messages of its flavour behind it."""

from __future__ import annotations

import sys
from pathlib import Path

import rosidl_py_gen

SHIM = Path(rosidl_py_gen.__file__).parent / "rclpy"

sys.path.insert(0, str(SHIM))
rosidl_py_gen.install_import_hook(flavour="rclpy", shadow=True)
