"""Table of the Python packages of ROS that ``rosidl-py launch --install`` installs, and texts about them.

The packages are neither bundled nor on the Python package index.
"""

from __future__ import annotations

from rosidl_py_gen.base.distributions import Distribution

REPOSITORIES = {
    "ros2/launch": ("launch", "launch_xml", "launch_yaml", "launch_testing", "launch_pytest"),
    "ros2/launch_ros": ("launch_ros", "launch_testing_ros"),
    "ros-navigation/navigation2": ("nav2_common", "nav2_simple_commander"),
}
"""Packages in each GitHub repository; the branches of a repository have the names of the ROS distributions."""
LAUNCH_PACKAGES = ("launch", "launch_xml", "launch_yaml", "launch_ros")
"""Packages of ROS that ``rosidl-py launch`` needs. The package `launch` of the Python package index is another one:
docs/internals/protocol.md 15."""
MESSAGES = {
    "nav2_simple_commander": {
        "ros-geographic-info/geographic_info": ("geographic_msgs",),
        "ros-navigation/navigation2": ("nav2_msgs",),
    }
}
"""Message packages that a package of the table imports and that are not bundled, by repository."""


def repository_of(package: str) -> str:
    """Return the repository of a package, such as ``ros2/launch``; "" for an unknown package."""
    return next((repository for repository, packages in REPOSITORIES.items() if package in packages), "")


def install_command_of(*packages: str) -> str:
    """Return the command that installs packages of the table, for the selected distribution."""
    choice = Distribution.selected()
    names = [name for name in packages if name not in LAUNCH_PACKAGES]
    distro = ["--distro", choice.name] if choice.is_explicit else []
    return " ".join(("rosidl-py launch --install", *names, *distro))


def install_note(package: str) -> str:
    """Return a text about where a package of the table is, with the command that installs it.

    Returns "" for an unknown package.
    """
    repository = repository_of(package)
    return repository and f"{package} is in https://github.com/{repository}: {install_command_of(package)}"
