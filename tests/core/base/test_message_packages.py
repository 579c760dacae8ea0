"""The table of well-known message packages, and the download notes made from it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from support.folders import ROOT

from rosidl_py_gen.base import package_repositories
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.package_repositories import MessagePackage

FILE = Path(package_repositories.__file__).with_name("message_packages.txt")
LINES = FILE.read_text(encoding="utf-8").splitlines()
ROWS = [line.split() for line in LINES if not line.startswith("#")]
PACKAGES = sorted({name for row in ROWS for name in row[5:]})
BUNDLED = {path.name for path in (ROOT / "interfaces").glob("**/")}


def test_message_package_table_is_small_and_states_source_and_date() -> None:
    assert 150 <= len(PACKAGES) <= 200 and FILE.stat().st_size <= 20_000
    assert re.search(r"Source: github\.com/ros/rosdistro, [0-9a-f]{10} of 20\d\d-\d\d-\d\d", LINES[0])
    assert not BUNDLED & set(PACKAGES)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_table_row_has_repository_branch_for_each_distribution_and_packages(row: list[str]) -> None:
    repository, *branches = row[:5]
    assert re.fullmatch(r"(https://[\w.-]+/)?[\w.-]+/[\w./-]+", repository) and not repository.endswith(".git")
    assert len(branches) == len(Distribution.BUNDLED) and branches[0] != "=" and set(branches) != {"-"}
    assert all(re.fullmatch(r"[\w./-]+|=", branch) and not branch.startswith("--") for branch in branches)
    assert row[5:] and all(re.fullmatch(r"[a-z]\w+", package) for package in row[5:])


@pytest.mark.parametrize("distro", Distribution.BUNDLED)
def test_each_package_has_a_clone_command_for_each_distribution(distro: str) -> None:
    command = re.compile(r"git clone --depth 1 --branch ([\w./-]+) (https://[\w./-]+); then use --path ([\w.-]+) ")
    for package in PACKAGES:
        found = command.search(MessagePackage(package).download_note(distro))
        assert found is not None and found[2].endswith("/" + found[3]) and found[1] not in ("-", "=")


@pytest.mark.parametrize(
    ("package", "distro", "text"),
    [
        ("control_msgs", "humble", "github.com/ros-controls/control_msgs, branch humble:"),
        ("control_msgs", "jazzy", "github.com/ros-controls/control_msgs, branch jazzy:"),
        ("nav2_msgs", "kilted", "navigation2, branch kilted:"),
        ("px4_msgs", "jazzy", "github.com/PX4/px4_msgs, branch main:"),
        ("gazebo_msgs", "kilted", "gazebo_ros_pkgs, branch ros2 (of humble; it has none for kilted):"),
        ("rmf_task_msgs", "lyrical", "rmf_internal_msgs, branch main:"),
        ("plansys2_msgs", "humble", "branch jazzy-devel (of jazzy; it has none for humble):"),
    ],
)
def test_download_note_has_branch_of_the_distribution_or_the_nearest_one(package: str, distro: str, text: str) -> None:
    assert text in MessagePackage(package).download_note(distro)


def test_download_note_is_empty_for_unknown_package_or_missing_table(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [MessagePackage(name).download_note("jazzy") for name in ("my_robot_msgs", "std_msgs")] == ["", ""]
    monkeypatch.setattr(package_repositories, "TABLE_FILE", Path("/nowhere"))
    package_repositories.package_rows.cache_clear()
    try:
        assert MessagePackage("control_msgs").download_note("jazzy") == ""
    finally:
        package_repositories.package_rows.cache_clear()
