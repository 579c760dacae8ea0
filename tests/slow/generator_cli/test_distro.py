"""``--distro`` of both command lines, and ``rosidl-py-gen diff`` between two distributions."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.generator_shell import Shell
from support.interface_packages import write

from rosidl_py_gen import ros_cli
from rosidl_py_gen.base.distributions import Distribution

RANGE = "sensor_msgs/msg/Range"


def test_generated_packages_follow_selected_distribution(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    text = "sensor_msgs/msg/_range.py"
    assert shell("--distro", "humble", "--filter", RANGE, "--out", "humble").code == 0
    assert shell("--filter", RANGE, "--out", "jazzy").code == 0
    monkeypatch.setenv("ROS_DISTRO", "humble")
    assert shell("--filter", RANGE, "--out", "environment").code == 0
    humble, jazzy, other = ((shell.folder / one / text).read_text() for one in ("humble", "jazzy", "environment"))
    assert "variance" not in humble and "variance" in jazzy and other == humble
    assert Distribution.selected() == ("humble", False)


def test_distro_option_is_accepted_before_and_after_command(shell: Shell) -> None:
    for words in (("--distro", "Humble", "interface", RANGE), ("interface", RANGE, "--distro", "humble")):
        answer = shell(*words)
        assert answer.code == 0 and "RIHS01_9430b1915b94" in answer.out and "variance" not in answer.out
    assert "turtlesim_msgs" in shell("--distro", "rolling", "--list").out
    assert "turtlesim_msgs" not in shell("--list").out


def test_unknown_distribution_exits_with_2(shell: Shell) -> None:
    answer = shell("--distro", "foxy", "--list")
    assert answer.code == 2 and "'foxy' is not one of 'humble', 'jazzy', 'kilted', 'lyrical'" in answer.err


def test_diff_compares_two_distributions(shell: Shell) -> None:
    answer = shell("diff", "--distro", "humble", "--distro", "lyrical")
    assert answer.code == 1
    lines = answer.out.splitlines()
    for line in (
        "- geometry_msgs/msg/Pose2D",
        "+ nav_msgs/msg/Trajectory",
        "+ service_msgs/msg/ServiceEventInfo",
        "+ turtlesim_msgs/srv/Spawn",
        "- turtlesim/srv/Spawn",
        "~ lifecycle_msgs/msg/TransitionEvent",
        "~ rmw_dds_common/msg/Gid",
        "~ sensor_msgs/msg/Range",
    ):
        assert line in lines
    assert not any("std_msgs" in line for line in lines)
    same = shell("diff", "distro:jazzy", "--distro", "jazzy")
    assert same.code == 0


def test_diff_compares_distribution_with_folder(shell: Shell) -> None:
    write(shell.folder / "own", {"sensor_msgs/msg/Range.msg": "int8 mine\n"})
    answer = shell("diff", "--distro", "humble", "own", "--filter", RANGE)
    assert answer.code == 1 and "+ mine: int8" in answer.out and "- max_range: float32" in answer.out


@pytest.mark.parametrize(
    "words",
    [("--distro", "humble"), ("distro:humble",), ("--distro", "humble", "--distro", "jazzy", "--distro", "kilted"), ()],
)
def test_diff_needs_two_sources(shell: Shell, words: tuple[str, ...]) -> None:
    answer = shell("diff", *words)
    assert answer.code == 2 and "expected OLD and NEW, each a source or --distro NAME" in answer.err


def test_diff_of_unknown_distribution_is_an_error(shell: Shell) -> None:
    answer = shell("diff", "distro:foxy", "distro:jazzy")
    assert answer.code == 1 and "no definitions of the ROS distribution 'foxy'" in answer.out + answer.err


def test_interface_command_of_rosidl_py_has_distro_option(capsys: pytest.CaptureFixture[str]) -> None:
    ros_cli.main(["interface", "show", "sensor_msgs/Range", "--distro", "humble"])
    assert "variance" not in capsys.readouterr().out
    ros_cli.main(["interface", "show", "sensor_msgs/Range"])
    assert "variance" in capsys.readouterr().out
    ros_cli.main(["interface", "hash", "lifecycle_msgs/TransitionEvent", "--distro", "lyrical"])
    assert "78b19e2be41a" in capsys.readouterr().out
    assert not Distribution.selected().is_explicit


def test_run_command_uses_messages_of_selected_distribution(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import os\n"
        "from sensor_msgs.msg import Range\n"
        "from rosidl_py_gen.runtime import Context, MemoryTransport\n"
        "print(os.environ['ROS_DISTRO'], 'variance' in Range.get_fields_and_field_types())\n"
        "with Context(args=['x'], transport=MemoryTransport()) as context:\n"
        "    print([context.settings.ros_distro])\n"
    )
    # Without a selection, nodes announce themselves in the format that the network needs.
    for options, expected in (((), "jazzy True\n['']\n"), (("--distro", "humble"), "humble False\n['humble']\n")):
        command = [sys.executable, "-m", "rosidl_py_gen.ros_cli", "run", *options, str(program)]
        environ = {name: value for name, value in os.environ.items() if name != "ROS_DISTRO"}
        done = subprocess.run(command, capture_output=True, text=True, check=True, env=environ)
        assert done.stdout == expected
