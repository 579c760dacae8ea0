"""Tables of repositories with packages that are neither bundled nor on the Python package index, for error texts.

`message_packages.txt` lists well-known message packages; nothing of it is downloaded. The second table lists Python
packages of ROS, which ``rosidl-py launch --install`` installs.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from rosidl_py_gen.base.distributions import DISTRIBUTIONS, selected

TABLE_FILE = Path(__file__).with_name("message_packages.txt")


@cache
def package_rows() -> dict[str, list[str]]:
    """Return the table of well-known message packages by package name: repository, branches and packages of that
    repository.

    Returns {} if the table cannot be read.
    """
    try:
        lines = TABLE_FILE.read_text(encoding="utf-8").splitlines()
    except OSError:
        return {}
    rows = [line.split() for line in lines if not line.startswith("#")]
    rows.sort(key=lambda row: "-" not in row)  # a repository may have a package in older distributions only
    return {package: row for row in rows for package in row[1 + len(DISTRIBUTIONS) :]}


def branch_of(package: str, distro: str) -> tuple[str, str]:
    """Return the branch of a well-known package, and its distribution.

    If the package has no branch for `distro`, the branch of the next older distribution is returned, or else of the
    next newer. The branch of an unknown package has the name of the distribution.
    """
    row = package_rows().get(package)
    if row is None:
        return distro, distro
    branches: list[str] = []
    for word in row[1 : 1 + len(DISTRIBUTIONS)]:
        branches.append(branches[-1] if word == "=" else word)
    wanted = DISTRIBUTIONS.index(distro)
    older, newer = range(wanted, -1, -1), range(wanted + 1, len(DISTRIBUTIONS))
    used = next(number for number in (*older, *newer) if branches[number] != "-")
    return branches[used], DISTRIBUTIONS[used]


def download_note(package: str, distro: str) -> str:
    """Return a text about where a well-known package can be found, with the commands to get and use it.

    Returns "" for an unknown package.
    """
    row = package_rows().get(package)
    if row is None:
        return ""
    url = row[0] if "://" in row[0] else f"https://github.com/{row[0]}"
    (branch, used), folder = branch_of(package, distro), url.rpartition("/")[2]
    instead = "" if used == distro else f" (of {used}; it has none for {distro})"
    return (
        f"{package} is in {url}, branch {branch}{instead}: git clone --depth 1 --branch {branch} {url}; then use "
        f"--path {folder} (in Python path=), or install it: rosidl-py-gen --path {folder} --filter {package} --install"
    )


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
    choice = selected()
    names = [name for name in packages if name not in LAUNCH_PACKAGES]
    distro = ["--distro", choice.name] if choice.is_explicit else []
    return " ".join(("rosidl-py launch --install", *names, *distro))


def install_note(package: str) -> str:
    """Return a text about where a package of the table is, with the command that installs it.

    Returns "" for an unknown package.
    """
    repository = repository_of(package)
    return repository and f"{package} is in https://github.com/{repository}: {install_command_of(package)}"
