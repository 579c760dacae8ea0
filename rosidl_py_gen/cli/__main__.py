"""``python -m rosidl_py_gen.cli``."""

from rosidl_py_gen.cli import main

main()
