"""``python -m rosidl_py_gen.generator_cli``."""

from rosidl_py_gen.generator_cli import main

main()
