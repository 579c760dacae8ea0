"""Environment variables of processes that use a prefix."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from rosidl_py_gen.base.distributions import ASSUMED_VARIABLE, DEFAULT, ENVIRONMENT_VARIABLE, selected
from rosidl_py_gen.base.resources import RUN_PREFIX

SITE_PACKAGES = f"lib/python{sys.version_info[0]}.{sys.version_info[1]}/site-packages"
PROGRAMS = "lib/rosidl_py_gen/bin"
"""Folder of a prefix with programs that a ROS installation has on PATH, such as ros2."""
FIXED = {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3"}


def variables(prefix: Path | None) -> dict[str, str]:
    """Return environment variables for a process that uses a prefix (if not None).

    Variables with lists keep their current entries.
    """
    found = {name: os.environ.get(name, value) for name, value in FIXED.items()} | of_distribution()
    found[RUN_PREFIX] = ""
    for name, folder in folders(prefix).items() if prefix is not None else ():
        places = (str(folder), *filter(None, os.environ.get(name, "").split(os.pathsep)))
        found[name] = os.pathsep.join(dict.fromkeys(places))
    if prefix is not None:  # at the end: programs of a ROS installation precede
        found["PATH"] = os.pathsep.join(dict.fromkeys((*found["PATH"].split(os.pathsep), str(prefix / PROGRAMS))))
    return found


def of_distribution() -> dict[str, str]:
    """Return the variables that name the selected distribution; {} if only the user has set ROS_DISTRO."""
    choice = selected()
    if choice.is_explicit:
        return {ENVIRONMENT_VARIABLE: choice.name}
    is_default = os.environ.get(ENVIRONMENT_VARIABLE) in (None, "", os.environ.get(ASSUMED_VARIABLE))
    return {ASSUMED_VARIABLE: DEFAULT, ENVIRONMENT_VARIABLE: DEFAULT} if is_default else {}


def folders(prefix: Path) -> dict[str, Path]:
    """Return the folders of a prefix, each by the environment variable that lists it."""
    return {"AMENT_PREFIX_PATH": prefix, "PYTHONPATH": prefix / SITE_PACKAGES, "PATH": prefix / "bin"}
