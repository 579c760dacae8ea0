"""ROS packages whose executables are part of this package, or of packages on the package index."""

from __future__ import annotations

BUNDLED: dict[str, dict[str, str]] = {}
"""Packages with their executables, each as ``module:function``; sources with the same name replace them."""

ON_PACKAGE_INDEX = ("xacro",)
"""Packages of the package index that launch files use by their ROS names, if they are installed."""
