"""Definitions of several ROS 2 distributions: contents, selection and hashes."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from rosidl_py_gen import (
    DefinitionError,
    DistributionWarning,
    TypeNotFoundError,
    UnknownDistributionError,
    get_action,
    get_message,
    get_service,
    type_hash,
)
from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.base.resources import DataFolders
from rosidl_py_gen.compiler.frontend.bundled import BundledInterfaces, files_below
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import LoadedInterfaces
from rosidl_py_gen.type_loading.class_lookup import ClassSearch, distribution_definitions

# Computed by rosidl's own tools from the files of the distributions (docs/internals/protocol.md 1.9).
UPSTREAM = {
    ("sensor_msgs/msg/Range", "humble"): "9430b1915b94d4268ff903679e8ecd09b6a67d331bd028738ec1eeb592891ebd",
    ("sensor_msgs/msg/Range", "jazzy"): "b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a",
    ("rmw_dds_common/msg/Gid", "humble"): "af578f740a4c2f04ac7455b9cc48cba5cd5580b7aaecdaca7d11d65c1d5ec32c",
    ("rmw_dds_common/msg/Gid", "lyrical"): "ab6f21cfbb0a6dbb837161e1110c2051a2850ed9f9c53944d7115d9bcebedf71",
    ("rmw_dds_common/msg/NodeEntitiesInfo", "humble"): (
        "2f4fe7c6c96117fe4397bb6c0a87c8a952c1d5e7f25a63133a81b684c8456726"
    ),
    ("rmw_dds_common/msg/ParticipantEntitiesInfo", "humble"): (
        "a8ade1e13aeb0a06dfed30a0b315c682811598508f6fa4015aa543f00360ff7d"
    ),
    ("lifecycle_msgs/msg/TransitionEvent", "kilted"): (
        "d5f8873a2f0146498f812d7885c7327ce27e463d36811d8792f35ee38c0d6c38"
    ),
    ("lifecycle_msgs/msg/TransitionEvent", "lyrical"): (
        "78b19e2be41a797fc009c96bda68944182edabec7852cccd928a40bc06f6f9d7"
    ),
    ("geometry_msgs/msg/Pose2D", "jazzy"): "d68efa5b46e70f7b16ca23085474fdac5a44b638783ec42f661da64da4724ccc",
    ("nav_msgs/msg/Goals", "humble"): "02305a51633b5c04d8979b878a7577cafd422f8a07465c878b17a920af3759e9",
    ("nav_msgs/msg/Trajectory", "lyrical"): "d3913ce7dde2bcfce38a35aa69952c5e5e9abd274a4f85d5c46f16d875c04d83",
    ("nav_msgs/msg/TrajectoryPoint", "lyrical"): "f0861d4358bd21bf3fc1372a490ad3ae9cac4df45461f9f772cea2a9ad71587c",
    ("geometry_msgs/msg/VelocityWithCovarianceStamped", "lyrical"): (
        "f0957be0a63943af8b24abcb20e4e1fc8b71368e872dbf802f87b8a2ca8e60a0"
    ),
    ("turtlesim_msgs/msg/Pose", "kilted"): "37b07ace09a0ed2c5b774b1410dec972dfd1d292de5656ebc2b075ac646e09c8",
}


@pytest.mark.parametrize(("name", "distro"), UPSTREAM)
def test_definition_of_a_distribution_has_the_hash_computed_by_rosidl(name: str, distro: str) -> None:
    assert type_hash(get_message(name, distro=distro)) == f"RIHS01_{UPSTREAM[name, distro]}"


@pytest.mark.parametrize("distro", Distribution.BUNDLED)
def test_every_definition_of_a_distribution_is_valid(distro: str) -> None:
    search = SearchPath.scan(ament="", distro=distro)
    _, names = LoadedInterfaces.load(search, [])
    assert len(names) == sum(len(package.files) for package in search.packages.values())


def test_stored_definitions_of_a_distribution_differ_from_the_default_and_are_used() -> None:
    top = DataFolders.interfaces() / "distributions"
    for distro in os.listdir(top):
        if distro != "COLCON_IGNORE":
            stored = [files_below(one, top / distro / one) for one in os.listdir(top / distro) if one != "absent.txt"]
            names = {name for files in stored for name in files}
            assert names <= BundledInterfaces.of(distro).changed
            for name, path in ((name, path) for files in stored for name, path in files.items()):
                default = DataFolders.interfaces() / name.package / name.kind / path.name
                assert not default.exists() or default.read_text() != path.read_text()


def test_types_equal_in_several_distributions_have_one_class() -> None:
    classes = {get_message("geometry_msgs/PoseStamped", distro=distro) for distro in (None, *Distribution.BUNDLED)}
    assert len(classes) == 1
    assert len({get_message("sensor_msgs/Range", distro=distro) for distro in Distribution.BUNDLED}) == 2
    assert get_service("std_srvs/SetBool", distro="humble") is get_service("std_srvs/SetBool")
    assert get_action("turtlesim_msgs/RotateAbsolute", distro="kilted")


def test_classes_have_constants_and_defaults_of_the_selected_distribution() -> None:
    assert get_message("sensor_msgs/NavSatStatus")().status == -2
    humble = get_message("sensor_msgs/NavSatStatus", distro="humble")
    assert humble().status == 0 and not hasattr(humble, "STATUS_UNKNOWN")
    assert not hasattr(get_message("visualization_msgs/MarkerArray", distro="humble")().markers, "ARROW_STRIP")


@pytest.mark.parametrize(
    ("name", "distro", "part"),
    [
        ("nav_msgs/msg/Trajectory", None, "it is part of lyrical only: select that with --distro"),
        ("turtlesim_msgs/msg/Pose", "jazzy", "it is part of kilted and lyrical only"),
        ("geometry_msgs/msg/Pose2D", "lyrical", "it is part of humble, jazzy and kilted only"),
        ("rcl_interfaces/msg/LoggerLevel", "humble", "it is part of jazzy, kilted and lyrical only"),
        ("turtlesim/msg/Pose", "lyrical", "it is part of humble and jazzy only"),
    ],
)
def test_error_for_a_missing_type_lists_the_distributions_that_have_it(
    name: str, distro: str | None, part: str
) -> None:
    with pytest.raises(TypeNotFoundError) as caught:
        get_message(name, distro=distro)
    assert part in str(caught.value)


def test_error_for_a_definition_with_a_missing_type_lists_its_distributions(tmp_path: Path) -> None:
    (tmp_path / "a_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "a_msgs" / "msg" / "A.msg").write_text("geometry_msgs/Pose2D pose\n")
    assert get_message("a_msgs/A", path=tmp_path, distro="kilted")
    with pytest.raises(DefinitionError, match="it is part of humble, jazzy and kilted only"):
        get_message("a_msgs/A", path=tmp_path, distro="lyrical")


def test_distribution_definitions_lists_each_definition_with_its_distributions() -> None:
    found = distribution_definitions("sensor_msgs/msg/Range")
    assert [one.distributions for one in found] == [("humble",), ("jazzy", "kilted", "lyrical")]
    for one in found:
        assert type_hash(one.load()) == one.type_hash
    assert distribution_definitions("std_msgs/msg/String") == distribution_definitions("no_msgs/msg/Thing") == ()
    assert [one.distributions for one in distribution_definitions("turtlesim_msgs/srv/Spawn_Request")] == [
        ("kilted", "lyrical")
    ]


def test_classes_by_hash_are_found_in_all_distributions() -> None:
    for name, distro in (("nav_msgs/msg/Trajectory", "lyrical"), ("sensor_msgs/msg/Range", "humble")):
        wanted = f"RIHS01_{UPSTREAM[name, distro]}"
        cls = ClassSearch().find(name, lambda hashes, name=name, wanted=wanted: hashes[name] == wanted)  # type: ignore[misc]
        assert cls is not None and type_hash(cls) == wanted
        assert ClassSearch().origin(cls) == f"bundled ({distro})"


@pytest.mark.parametrize("wrong", ["foxy", "", "Jazzy Jalisco", "../humble", "\x1b[31m"])
def test_an_unknown_distribution_is_an_error(wrong: str) -> None:
    with pytest.raises(UnknownDistributionError, match="expected humble, jazzy, kilted, lyrical") as caught:
        get_message("std_msgs/String", distro=wrong)
    assert "\x1b" not in str(caught.value)


def test_names_of_distributions_are_read_in_any_case() -> None:
    assert Distribution.selected("HUMBLE") == ("humble", True)
    assert Distribution.selected("rolling") == ("lyrical", True)


def test_unknown_distribution_in_the_environment_is_warned_about_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "galactic")
    with pytest.warns(DistributionWarning, match="no definitions of 'galactic'; using the definitions of jazzy"):
        assert get_message("std_msgs/Bool")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Distribution.selected() == ("jazzy", False)


def test_distribution_of_a_command_is_selected_for_its_duration(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "kilted")
    with Distribution.of_command("lyrical"):
        assert Distribution.selected() == ("lyrical", True)
        assert Distribution.selected("humble") == ("humble", True)
        with Distribution.of_command("humble"), Distribution.of_command("lyrical"):
            assert Distribution.selected().name == "lyrical"
        assert Distribution.selected().name == "lyrical"
    assert Distribution.selected() == ("kilted", False)


def test_explicit_distribution_overrides_ament_but_not_the_given_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "stereo_msgs/DisparityImage"
    folder = tmp_path / "share" / "stereo_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "DisparityImage.msg").write_text("int8 mine\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setenv("ROS_DISTRO", "humble")
    assert get_message(name)().mine == 0
    assert get_message(name, distro="jazzy")().min_disparity == 0.0
    other = tmp_path / "other" / "stereo_msgs" / "msg"
    other.mkdir(parents=True)
    (other / "DisparityImage.msg").write_text("int8 mine_too\n")
    assert get_message(name, path=tmp_path / "other", distro="jazzy")().mine_too == 0


@pytest.mark.slow
def test_wheels_of_ros_are_on_the_search_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wheels install into `share` of the environment; folders that the ament index lacks are not read."""
    for package in ("acme_msgs", "sensor_msgs", "ros1_msgs"):
        folder = tmp_path / "share" / package / "msg"
        folder.mkdir(parents=True)
        (folder / "Range.msg").write_text("int8 installed\n")
    index = tmp_path / "share" / "ament_index" / "resource_index" / "rosidl_interfaces"
    index.mkdir(parents=True)
    for package in ("acme_msgs", "sensor_msgs", "gone_msgs", "..", "Not_a_package"):
        if package != "..":
            (index / package).write_text("msg/Range.msg\n")
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    search = SearchPath.scan(ament="")
    assert search.packages["acme_msgs"].origin == search.packages["sensor_msgs"].origin == "installed"
    assert not {"ros1_msgs", "gone_msgs", "Not_a_package"} & search.packages.keys()
    assert search.packages["std_msgs"].origin == "bundled"
    assert SearchPath.scan(ament="", distro="jazzy").packages["sensor_msgs"].origin == "bundled"


@pytest.mark.slow
def test_default_distribution_needs_no_compiler_for_the_selection() -> None:
    program = (
        "import sys, rosidl_py_gen; rosidl_py_gen.get_message('rcl_interfaces/Parameter');"
        "print('rosidl_py_gen.compiler.frontend.bundled' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.mark.slow
def test_import_hook_uses_a_distribution_given_as_argument() -> None:
    program = """
from rosidl_py_gen import found_packages, install_import_hook, type_hash
hook = install_import_hook({settings}, distro="humble")
from lifecycle_msgs.msg import TransitionEvent
from rcl_interfaces.msg import Log
from sensor_msgs.msg import Range
import rcl_interfaces.msg
print(Range.get_fields_and_field_types() if hasattr(Range, "get_fields_and_field_types") else Range.__slots__)
print(type(Log.DEBUG).__name__, hasattr(rcl_interfaces.msg, "LoggerLevel"))
found = found_packages()["sensor_msgs"]
print("variance" in (found.folder / "msg" / "Range.msg").read_text(), (found.share / "msg" / "Imu.msg").is_file())
print((found_packages()["rcl_interfaces"].folder / "msg" / "LoggerLevel.msg").exists())
"""
    for message_api, kind in (("native", "int"), ("rclpy", "bytes")):
        text = program.format(settings=f"message_api={message_api!r}")
        done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
        fields, *others = done.stdout.splitlines()
        assert "max_range" in fields and "variance" not in fields
        assert others == [f"{kind} False", "False True", "False"]
