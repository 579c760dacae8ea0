"""Command ``rosidl-py prefix``: an ament prefix of source packages, made without a build."""

from rosidl_py_gen.ros_cli.prefix.build import Prefix as Prefix
from rosidl_py_gen.ros_cli.prefix.build import build_prefix as build_prefix
