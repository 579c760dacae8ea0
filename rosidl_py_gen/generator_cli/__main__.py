"""Entry point of ``python -m rosidl_py_gen.generator_cli``, which runs the command line `rosidl-py-gen`."""

from rosidl_py_gen.generator_cli.commands import main

main()
