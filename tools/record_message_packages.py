"""Record where well-known message packages are: `rosidl_py_gen/base/message_packages.txt`.

Run ``python tools/record_message_packages.py ROSDISTRO REPOSITORY...`` with git folders: of
github.com/ros/rosdistro, and of public repositories with ROS packages. The packages of `_WANTED` are recorded, then
those on which the most repositories depend or that they import, then those that the most distributions have. Branches
are those of the sources in rosdistro. Branches that a given repository lacks are printed: it may be an old snapshot.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from rosidl_py_gen.base.distributions import Distribution

_CHECKOUT = Path(__file__).resolve().parents[1]
FILE = _CHECKOUT / "rosidl_py_gen" / "base" / "message_packages.txt"
MAX_PACKAGES = 200
GITHUB = "https://github.com/"
_MESSAGE_PACKAGE = re.compile(r"\w+_(msgs?|srvs|interfaces|actions)")
_OTHER_PACKAGE = re.compile(
    r"(tf2|rosidl|ament)_\w+|\w*_?test_\w+|\w*hardware_interfaces|common_interfaces|\w+_robot_interfaces|rqt_msg"
)
_WANTED = frozenset(
    [
        "ackermann_msgs",
        "apriltag_msgs",
        "autoware_control_msgs",
        "autoware_map_msgs",
        "autoware_perception_msgs",
        "autoware_planning_msgs",
        "autoware_system_msgs",
        "autoware_vehicle_msgs",
        "can_msgs",
        "cartographer_ros_msgs",
        "composition_interfaces",
        "control_msgs",
        "controller_manager_msgs",
        "depthai_ros_msgs",
        "foxglove_msgs",
        "gazebo_msgs",
        "geographic_msgs",
        "gps_msgs",
        "grid_map_msgs",
        "irobot_create_msgs",
        "marti_nav_msgs",
        "mavros_msgs",
        "micro_ros_msgs",
        "moveit_msgs",
        "nav2_msgs",
        "nmea_msgs",
        "novatel_gps_msgs",
        "object_recognition_msgs",
        "octomap_msgs",
        "pcl_msgs",
        "plotjuggler_msgs",
        "px4_msgs",
        "radar_msgs",
        "realsense2_camera_msgs",
        "robot_localization",
        "ros_gz_interfaces",
        "rosapi_msgs",
        "rosbag2_interfaces",
        "rosbridge_msgs",
        "slam_toolbox",
        "statistics_msgs",
        "test_msgs",
        "turtlebot3_msgs",
        "turtlebot4_msgs",
        "ublox_msgs",
        "velodyne_msgs",
        "vision_msgs",
        "webots_ros2_msgs",
        "zed_msgs",
    ]
)
_NOT_IN_ROSDISTRO = {
    "go2_interfaces": ("abizovnuralem/go2_ros2_sdk", "master"),
    "llama_msgs": ("mgonzs13/llama_ros", "main"),
    "yolo_msgs": ("mgonzs13/yolo_ros", "main"),
}


def main() -> None:
    rosdistro, *repositories = map(Path, sys.argv[1:])
    places = _places(rosdistro)
    bundled = {path.name for path in (_CHECKOUT / "interfaces").glob("**/") if "_" in path.name}
    usage: Counter[str] = Counter()
    for repository in repositories:
        usage.update(_mentioned(repository))
    known = [name for name in places if name not in bundled]
    known.sort(key=lambda name: (name not in _WANTED, -usage[name], -len(places[name]), name))
    by_place: dict[str, list[str]] = {}
    for name in known[:MAX_PACKAGES]:
        by_place.setdefault(_place_text(places[name]), []).append(name)
    _print_missing_branches(by_place, {_url(repository): repository for repository in repositories})
    commit = _git(rosdistro, "log", "-1", "--format=%h of %cs").strip()
    lines = [
        f"# Repositories of well-known message packages. Source: github.com/ros/rosdistro, {commit}, by",
        "# tools/record_message_packages.py. A line has the repository (of GitHub without a host), its",
        f"# branches for {', '.join(Distribution.BUNDLED)} (- for none, = for that before), and the packages.",
        *(f"{place} {' '.join(sorted(names))}" for place, names in sorted(by_place.items())),
    ]
    FILE.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(known[:MAX_PACKAGES])} packages, {FILE.stat().st_size} bytes")


def _places(rosdistro: Path) -> dict[str, dict[str, tuple[str, str]]]:
    """Return URL and branch of each message package by distribution; what the newest lacks is taken from Rolling."""
    places: dict[str, dict[str, tuple[str, str]]] = {}
    for distro in ("rolling", *Distribution.BUNDLED):
        text = _git(rosdistro, "show", f"HEAD:{distro}/distribution.yaml")
        data: dict[str, Any] = yaml.load(text, yaml.CSafeLoader)
        for name, repository in data["repositories"].items():
            source = repository.get("source") or repository.get("doc") or {}
            for package in (repository.get("release") or {}).get("packages", [name]):
                is_message = _MESSAGE_PACKAGE.fullmatch(package) and not _OTHER_PACKAGE.fullmatch(package)
                if source.get("type") == "git" and source.get("version") and (is_message or package in _WANTED):
                    key = Distribution.BUNDLED[-1] if distro == "rolling" else distro
                    places.setdefault(package, {})[key] = (source["url"].removesuffix(".git"), source["version"])
    for package, (repository, branch) in _NOT_IN_ROSDISTRO.items():
        places[package] = dict.fromkeys(Distribution.BUNDLED, (GITHUB + repository, branch))
    return places


def _place_text(place: dict[str, tuple[str, str]]) -> str:
    url = [place[distro][0] for distro in Distribution.BUNDLED if distro in place][-1]
    words, last = [url.removeprefix(GITHUB)], ""
    for distro in Distribution.BUNDLED:  # a fork that only older distributions use is left out
        branch = place[distro][1] if distro in place and place[distro][0] == url else "-"
        words.append("=" if branch == last else branch)
        last = branch
    return " ".join(words)


def _mentioned(repository: Path) -> set[str]:
    """Return the packages that a repository depends on or imports, without its own."""
    manifests = _git(repository, "grep", "-h", "-E", "<(name|[a-z_]*depend)[^>]*>", "HEAD", "--", "*package.xml")
    own = set(re.findall(r"<name>\s*(\w+)\s*<", manifests))
    imports = _git(repository, "grep", "-h", "-E", r"^\s*from \w+\.(msg|srv|action) import", "HEAD", "--", "*.py")
    found = re.findall(r"depend[^>]*>\s*(\w+)\s*<", manifests) + re.findall(r"from (\w+)\.", imports)
    return set(found) - own


def _url(repository: Path) -> str:
    """Return the owner and name of a mirror such as ``owner+name/repo``."""
    folder = repository.name if repository.name != "repo" else repository.parent.name
    return folder.replace("+", "/")


def _print_missing_branches(places: Iterable[str], repositories: dict[str, Path]) -> None:
    confirmed = 0
    for place in places:
        url, *words = place.split()
        branches = set(words[: len(Distribution.BUNDLED)]) - {"-", "="}
        if url in repositories:
            existing = set(_git(repositories[url], "for-each-ref", "--format=%(refname:lstrip=2)").split())
            confirmed += len(branches & existing)
            for branch in branches - existing:
                date = _git(repositories[url], "log", "-1", "--all", "--format=%cs").strip()
                print(f"{url}: no branch {branch} in the snapshot of {date}")
    print(f"{confirmed} branches are in the given repositories")


def _git(folder: Path, *words: str) -> str:
    done = subprocess.run(["git", "--git-dir", str(folder), *words], capture_output=True, text=True, errors="replace")
    return done.stdout


if __name__ == "__main__":
    main()
