"""Command ``rosidl-py prefix``: an ament prefix of source packages, made without a build."""

from rosidl_py_gen.ros_cli.prefix.build import Prefix, build_prefix

__all__ = ["Prefix", "build_prefix"]
