"""``python -m rosidl_py_gen.ros_cli``."""

from rosidl_py_gen.ros_cli import main

main()
