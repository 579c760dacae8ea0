"""Stub of launch; see README."""

from __future__ import annotations

import os

from launch import actions as actions
from launch import launch_description_sources as launch_description_sources
from launch.core import Action as Action
from launch.core import LaunchDescription as LaunchDescription
from launch.core import LaunchDescriptionEntity as LaunchDescriptionEntity
from launch.core import LaunchDescriptionSource as LaunchDescriptionSource
from launch.launch_service import LaunchService as LaunchService

if "LAUNCH_STUB_LOOKUP" in os.environ:  # as launch/frontend/parse_substitution.py, which reads its grammar
    from ament_index_python.packages import get_package_share_directory

    assert os.path.isfile(os.path.join(get_package_share_directory("launch"), "package.xml"))


class LaunchIntrospector:
    def format_launch_description(self, description: LaunchDescription) -> str:
        return "\n".join(["<description>", *(f"├── {type(one).__name__}" for one in description.entities)])
