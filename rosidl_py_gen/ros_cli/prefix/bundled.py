"""ROS packages whose executables are part of this package, or of packages on the package index."""

from __future__ import annotations

BUNDLED: dict[str, dict[str, str]] = {
    "joint_state_publisher": {"joint_state_publisher": "rosidl_py_gen.robot.joint_state_publisher:main"},
    "robot_state_publisher": {"robot_state_publisher": "rosidl_py_gen.robot.robot_state_publisher:main"},
    "tf2_ros": {"static_transform_publisher": "rosidl_py_gen.robot.static_transform_publisher:main"},
}
"""Packages with their executables, each as ``module:function``; sources with the same name replace them."""

ON_PACKAGE_INDEX = ("xacro",)
"""Packages of the package index that launch files use by their ROS names, if they are installed."""
