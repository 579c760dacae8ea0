"""Well-known message packages that are missing: the error names the repository, the branch and the command."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec

import pytest

from rosidl_py_gen import TypeNotFoundError, get_action, get_message, get_service, install_import_hook

CLONE = "git clone --depth 1 --branch {} https://github.com/{}; then use --path"


@pytest.mark.parametrize(
    ("distro", "branch"), [(None, "jazzy"), ("humble", "humble"), ("jazzy", "jazzy"), ("lyrical", "master")]
)
def test_error_for_a_missing_package_has_the_branch_of_its_distribution(distro: str | None, branch: str) -> None:
    text = CLONE.format(branch, "ros-controls/control_msgs")
    with pytest.raises(TypeNotFoundError, match='no package "control_msgs" for control_msgs/msg/JointJog') as error:
        get_message("control_msgs/msg/JointJog", distro=distro)
    assert text in str(error.value)
    for get, name in ((get_service, "control_msgs/srv/X"), (get_action, "control_msgs/action/X")):
        with pytest.raises(TypeNotFoundError) as error:
            get(name, distro=distro)  # type: ignore[operator]
        assert text in str(error.value)


def test_error_for_a_missing_package_uses_the_distribution_of_the_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "humble")
    with pytest.raises(TypeNotFoundError) as error:
        get_message("nav2_msgs/msg/Costmap")
    assert CLONE.format("humble", "ros-planning/navigation2") in str(error.value)


def test_import_error_for_a_missing_package_has_the_clone_command() -> None:
    with install_import_hook(distro="kilted"):
        assert find_spec("px4_msgs") is None
        for name in ("px4_msgs", "px4_msgs.msg"):
            with pytest.raises(ModuleNotFoundError) as error:
                import_module(name)
            assert error.value.name == "px4_msgs" and CLONE.format("main", "PX4/px4_msgs") in str(error.value)
        with pytest.raises(ModuleNotFoundError) as other:
            import_module("nobodys_msgs.msg")
        assert str(other.value) == "No module named 'nobodys_msgs'" and "px4_msgs" not in sys.modules
    with pytest.raises(ModuleNotFoundError) as without:
        import_module("px4_msgs.msg")
    assert str(without.value) == "No module named 'px4_msgs'"
