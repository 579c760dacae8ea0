"""Import of our rclpy in a process, as `rosidl-py run` does it for programs."""

from __future__ import annotations

from pathlib import Path

import rosidl_py_gen

FOLDER = Path(rosidl_py_gen.__file__).parent / "ros_compat"
INTERFACES = Path(__file__).resolve().parents[1] / "interfaces"


def install() -> None:
    rosidl_py_gen.install_import_hook(message_api="rclpy", override_installed=True, path=str(INTERFACES))
