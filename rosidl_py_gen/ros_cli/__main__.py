"""Entry point of ``python -m rosidl_py_gen.ros_cli``, which runs the command line ``rosidl-py``."""

from rosidl_py_gen.ros_cli import main

main()
