"""``python -m rosidl_py_gen.tools``."""

from rosidl_py_gen.tools import main

main()
