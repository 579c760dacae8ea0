"""The search path of tests, and the reference compilers."""

from support.rosidl_fixtures import no_installed_packages, rosidl

__all__ = ["no_installed_packages", "rosidl"]
