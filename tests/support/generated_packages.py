"""Message packages that are generated once for all tests of a process, and importable from then on."""

from __future__ import annotations

import atexit
import sys
import tempfile
from pathlib import Path

from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import generate

PACKAGES = [
    "example_interfaces",
    "geometry_msgs",
    "nav_msgs",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "visualization_msgs",
]
GENERATED = tempfile.TemporaryDirectory(prefix="runtime-tests-")
atexit.register(GENERATED.cleanup)
generate(SearchPath.scan([DataFolders.interfaces()], ament="", bundled=False), PACKAGES, Path(GENERATED.name))
sys.path.insert(0, GENERATED.name)
