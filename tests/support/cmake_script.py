"""The list that real CMake gives to `rosidl_generate_interfaces`, in script mode and without ROS."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

needs_cmake = pytest.mark.skipif(
    shutil.which("cmake") is None and os.environ.get("ROSIDL_TEST_REQUIRE_PEERS") != "1", reason="needs CMake"
)
_COMMANDS = r"""
cmake_policy(VERSION 3.20)
macro(project name)
  set(PROJECT_NAME ${name})
  set(PROJECT_SOURCE_DIR ${CMAKE_CURRENT_SOURCE_DIR})
endmacro()
macro(find_package name)
  if(NOT ${name} STREQUAL catkin)
    set(${name}_FOUND TRUE)
  endif()
endmacro()
macro(catkin_package)
endmacro()
macro(ament_package)
endmacro()
macro(rosidl_generate_interfaces target)
  cmake_parse_arguments(_ARG "ADD_LINTER_TESTS;SKIP_INSTALL" "LIBRARY_NAME" "DEPENDENCIES" ${ARGN})
  foreach(_file ${_ARG_UNPARSED_ARGUMENTS})
    message("LISTED ${_file}")
  endforeach()
endmacro()
"""


def listed_by_cmake(folder: Path, script: Path, cmake: str) -> set[str]:
    """Return the files that a CMakeLists.txt of a package folder lists, relative to the folder.

    `script` is the file to write; it is in another folder than the files that it reads, and has no configuring to
    repeat.
    """
    text = cmake.replace("CURRENT_LIST_DIR", "CURRENT_SOURCE_DIR").replace(" CONFIGURE_DEPENDS", "")
    script.write_text(f"{_COMMANDS}project(a_msgs)\n{text}\n")
    done = subprocess.run(
        ["cmake", "-P", str(script)],
        cwd=folder,
        env={**os.environ, "ROS_VERSION": "2"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    listed = re.findall("^LISTED (.*)$", done.stderr, re.MULTILINE)
    return {os.path.normpath(name.replace(f"{folder}/", "").replace(":", "/")) for name in listed}
