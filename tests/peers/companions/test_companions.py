"""Companions of rclpy: `ament_index_python` beside the real one, the others by recorded results."""

from __future__ import annotations

import os
import re
import textwrap
from pathlib import Path

import pytest
from support.environments import rclpy_python
from support.interface_packages import write
from support.program_processes import PACKAGE_XML, output_lines, run, started

pytestmark = pytest.mark.real_time("programs are processes")


INDEX = "share/ament_index/resource_index"
ASKED = """
import sys, warnings
warnings.showwarning = lambda message, category, *place: print("warning", category.__name__, message)
import ament_index_python as ament
from ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR, RESOURCE_INDEX_SUBFOLDER
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from ament_index_python.resources import get_resource
from ament_index_python.search_paths import get_search_paths

print(AMENT_PREFIX_PATH_ENV_VAR, RESOURCE_INDEX_SUBFOLDER, sorted(ament.__all__), PackageNotFoundError.__mro__[1:3])
for what in (
    lambda: ament.get_package_prefix("robot"),
    lambda: ament.get_package_share_directory("robot"),
    lambda: ament.get_package_share_directory("hollow"),
    lambda: ament.get_package_share_directory("hollow", print_warning=False),
    lambda: ament.get_package_share_path("robot"),
    lambda: ament.get_package_share_path("hollow"),
    lambda: ament.get_package_share_directory("second"),
    lambda: ament.get_package_share_directory("nobody"),
    lambda: ament.get_package_share_directory("no/body"),
    lambda: ament.get_package_share_directory("x"),
    lambda: ament.get_package_share_directory(""),
    lambda: {name: ament.get_packages_with_prefixes().get(name) for name in ("robot", "hollow", "second", ".hidden")},
    lambda: ament.get_resource("plugins", "robot"),
    lambda: ament.get_resource("plugins", "nobody"),
    lambda: ament.get_resource("plug/ins", "nobody"),
    lambda: ament.get_resource("plugins", "no\\\\body"),
    lambda: ament.get_resource("", "nobody"),
    lambda: ament.get_resource("plugins", ""),
    lambda: sorted(ament.get_resources("plugins").items()),
    lambda: ament.get_resources("nothing"),
    lambda: ament.get_resources("a/b"),
    lambda: {"packages", "plugins"} <= ament.get_resource_types(),
    lambda: ament.has_resource("plugins", "robot"),
    lambda: ament.has_resource("plugins", "nobody"),
    lambda: ament.has_resource("packages", "folder"),
    get_search_paths,
):
    try:
        print(repr(what()))
    except Exception as error:
        print(type(error).__mro__[:2], error)
"""


def _without_run_prefix(output: str) -> list[str]:
    return re.sub(r"'[^']*/prefix/\w{24}'(, )?", "", output).splitlines()


def test_ament_index_python_behaves_like_real_package(tmp_path: Path) -> None:
    real = rclpy_python()
    files = {
        f"first/{INDEX}/packages/robot": "",
        f"first/{INDEX}/packages/hollow": "",
        f"first/{INDEX}/packages/.hidden": "",
        f"first/{INDEX}/packages/folder/inside": "",
        f"first/{INDEX}/plugins/robot": "a;b\n",
        "first/share/robot/package.xml": "",
        f"other/{INDEX}/packages/second": "",
        f"other/{INDEX}/packages/robot": "",
        f"other/{INDEX}/plugins/robot": "c",
        f"other/{INDEX}/plugins/third": "c",
        "other/share/second/package.xml": "",
        "program.py": ASKED,
    }
    write(tmp_path, files)
    path = os.pathsep.join(str(tmp_path / name) for name in ("first", "not_there", "", "other"))
    found = run("program.py", cwd=tmp_path, AMENT_PREFIX_PATH=path)
    expected = started(real, "program.py", cwd=tmp_path, AMENT_PREFIX_PATH=path)
    assert expected.returncode == 0, expected.stderr
    assert _without_run_prefix(found.stdout) == expected.stdout.splitlines()
    assert found.stderr == ""


def test_ament_index_python_finds_packages_by_their_sources(tmp_path: Path) -> None:
    files = {
        "src/robot/package.xml": PACKAGE_XML.format("robot"),
        "src/robot_msgs/package.xml": PACKAGE_XML.format("robot_msgs"),
        "src/robot_msgs/msg/A.msg": "int32 a",
        "src/robot/main.py": """
            from ament_index_python.packages import *
            from ament_index_python import get_package_share_directory as share, get_resource, has_resource
            from ament_index_python import get_package_prefix, get_resource_types, get_packages_with_prefixes
            print(share("robot"), get_package_prefix("robot_msgs"), share("std_msgs").endswith("interfaces/std_msgs"))
            print(get_resource("rosidl_interfaces", "robot_msgs"), has_resource("rosidl_interfaces", "robot"))
            print(sorted(get_resource_types()), "robot" in get_packages_with_prefixes())
            from rosidl_runtime_py import get_interface_path, get_interfaces
            print(get_interface_path("robot_msgs/msg/A"), get_interfaces(["robot_msgs", "robot"]))
            try:
                share("nobody")
            except PackageNotFoundError as error:
                print(error)
        """,
    }
    write(tmp_path, {name: textwrap.dedent(text) for name, text in files.items()})
    found = run("src/robot/main.py", cwd=tmp_path)
    source = str((tmp_path / "src").resolve())
    assert _without_run_prefix(found.stdout) == [
        f"{source}/robot {source}/robot_msgs True",
        f"('msg/A.msg', '{source}/robot_msgs') False",
        "['packages', 'rosidl_interfaces'] True",
        f"{source}/robot_msgs/msg/A.msg {{'robot_msgs': ['msg/A']}}",
        "\"package 'nobody' not found, searching: []\"",
    ], found.stderr


def test_rosidl_runtime_py_formats_and_sets_messages(tmp_path: Path) -> None:
    text = """
        from rosidl_runtime_py import *
        from rosidl_runtime_py.utilities import get_action, get_interface, get_message, get_service
        from sensor_msgs.msg import BatteryState, LaserScan
        from geometry_msgs.msg import PoseArray, PoseStamped
        scan = LaserScan(ranges=[1, 2, 3])
        scan.header.frame_id = "laser"
        print(message_to_yaml(scan), end="")
        print(message_to_yaml(scan, no_arr=True, no_str=True, flow_style=True), end="")
        for settings in ({}, {"no_arr": True, "no_str": True}, {"truncate_length": 2}):
            print(message_to_csv(scan, **settings))
        print(message_to_ordereddict(scan, truncate_length=2)["ranges"], type(message_to_ordereddict(scan)).__name__)
        poses = PoseArray()
        values = {"header": "auto", "poses": [{"position": {"x": 1}}, {}]}
        left = set_message_fields(poses, values, expand_header_auto=True)
        left[0](PoseStamped().header.stamp)
        print(poses.poses[0].position.x, len(poses.poses), len(left))
        for wrong in ({"nothing": 1}, {"header": 3}, {"poses": 3}):
            try:
                set_message_fields(poses, wrong)
            except Exception as error:
                print(type(error).__name__)
        print(get_message("std_msgs/String").__name__, get_service("std_srvs/srv/SetBool").__name__)
        print(get_action("example_interfaces/Fibonacci").__name__, get_interface("std_msgs/msg/Int8").__name__)
        print(get_message_slot_types(scan)["ranges"].value_type.typename)
        try:
            get_message("std_srvs/srv/SetBool")
        except ValueError as error:
            print(error)
    """
    zero = "0.0,0.0,0.0,0.0,0.0,0.0,0.0"
    assert output_lines(tmp_path, text) == [
        *("header:", "  stamp:", "    sec: 0", "    nanosec: 0", "  frame_id: laser"),
        *("angle_min: 0.0", "angle_max: 0.0", "angle_increment: 0.0", "time_increment: 0.0", "scan_time: 0.0"),
        *("range_min: 0.0", "range_max: 0.0", "ranges:", "- 1.0", "- 2.0", "- 3.0", "intensities: []"),
        *("header:", "  stamp:", "    sec: 0", "    nanosec: 0", "  frame_id: '<string length: <5>>'"),
        *("angle_min: 0.0", "angle_max: 0.0", "angle_increment: 0.0", "time_increment: 0.0", "scan_time: 0.0"),
        *("range_min: 0.0", "range_max: 0.0", "ranges: '<sequence type: float, length: 3>'"),
        "intensities: '<sequence type: float, length: 0>'",
        f"0,0,laser,{zero},1.0,2.0,3.0,",
        f"0,0,<string length: <5>>,{zero},<sequence type: float, length: 3>,<sequence type: float, length: 0>",
        f"0,0,la...,{zero},1.0,2.0,...,",
        "[1.0, 2.0, '...'] OrderedDict",
        "1.0 2 1",
        *("AttributeError", "TypeError", "TypeError"),
        "String SetBool",
        "Fibonacci Int8",
        "float",
        "Expected the full name of a message, got 'std_srvs/srv/SetBool'",
    ]


def test_message_filters_synchronize_and_cache_messages(tmp_path: Path) -> None:
    text = """
        from message_filters import ApproximateTimeSynchronizer, Cache, SimpleFilter, Subscriber, TimeSynchronizer
        from geometry_msgs.msg import PointStamped
        from std_msgs.msg import String
        from rclpy.clock import ClockType
        from rclpy.time import Time

        def at(seconds):
            made = PointStamped()
            made.header.stamp = Time(seconds=seconds).to_msg()
            return made

        def ros(seconds): return Time(seconds=seconds, clock_type=ClockType.ROS_TIME)

        def times(*messages): return [Time.from_msg(one.header.stamp).nanoseconds // 10**8 for one in messages]

        a, b = SimpleFilter(), SimpleFilter()
        exact, near, cache = TimeSynchronizer([a, b], 10), ApproximateTimeSynchronizer([a, b], 10, 0.35), Cache(a, 3)
        exact.registerCallback(lambda *got: print("exact", times(*got[:2]), got[2:]), "more", 3)
        near.registerCallback(lambda *got: print("near", times(*got)))
        a.signalMessage(at(1))
        b.signalMessage(at(1.3))
        a.signalMessage(at(2))
        b.signalMessage(at(1))
        b.signalMessage(at(5))
        a.signalMessage(at(4))
        a.signalMessage(at(5))
        print(times(*cache.getInterval(ros(2), ros(4))), times(cache.getLast()))
        print(cache.getOldestTime().nanoseconds, cache.getLastestTime().nanoseconds, cache.getElemAfterTime(ros(6)))
        print(times(cache.getElemAfterTime(ros(3)), cache.getElemBeforeTime(ros(3))))

        import rclpy
        rclpy.init()
        node = rclpy.create_node("filters")
        both = [Subscriber(node, PointStamped, name) for name in ("one", "two")]
        print(both[0].getTopic(), both[0].topic_name, both[0].sub.qos_profile.depth)
        done = []
        synchronizer = ApproximateTimeSynchronizer(both, queue_size=5, slop=0.1)
        synchronizer.registerCallback(lambda *got: done.append(times(*got)))
        publishers = [node.create_publisher(PointStamped, name, 10) for name in ("one", "two")]
        for publisher in publishers:
            publisher.publish(at(7))
        while not done:
            rclpy.spin_once(node, timeout_sec=1)
        print(done)
        headerless = ApproximateTimeSynchronizer([a], 5, 0.1, allow_headerless=True)
        headerless.registerCallback(lambda got: print("headerless", got))
        headerless.add(String(data="x"), 0)
        ApproximateTimeSynchronizer([b], 5, 0.1).add(String(), 0)
        rclpy.shutdown()
    """
    assert output_lines(tmp_path, text) == [
        "near [10, 13]",
        "exact [10, 10] ('more', 3)",
        "exact [50, 50] ('more', 3)",
        "near [50, 50]",
        "[20, 40] [50]",
        "2000000000 5000000000 None",
        "[40, 20]",
        "one /one 10",
        "[[70, 70]]",
        "headerless std_msgs.msg.String(data='x')",
    ]


def test_tf2_ros_buffer_listener_and_broadcasters_exchange_transforms(tmp_path: Path) -> None:
    text = """
        import rclpy, tf2_ros
        from geometry_msgs.msg import PointStamped, TransformStamped
        from rclpy.duration import Duration
        from rclpy.time import Time
        from tf2_ros import Buffer, StaticTransformBroadcaster, TransformBroadcaster, TransformListener
        from tf2_ros.buffer import Buffer as Same
        from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener

        def at(parent, child, x, seconds=0.0):
            made = TransformStamped()
            made.header.frame_id, made.child_frame_id = parent, child
            made.header.stamp = Time(seconds=seconds).to_msg()
            made.transform.translation.x = x
            made.transform.rotation.w = 1.0
            return made

        rclpy.init()
        node = rclpy.create_node("frames")
        buffer = Buffer(node=node)
        listener = TransformListener(buffer, node)
        moving, fixed = TransformBroadcaster(node), StaticTransformBroadcaster(node)
        fixed.sendTransform([at("base", "laser", 1.0), at("base", "camera", 2.0)])
        moving.sendTransform([at("map", "base", 0.0, 10.0), at("map", "base", 10.0, 11.0)])
        future = buffer.wait_for_transform_async("map", "laser", Time())
        rclpy.spin_until_future_complete(node, future, timeout_sec=10)
        while not buffer.can_transform("map", "camera", Time(seconds=11)):
            rclpy.spin_once(node, timeout_sec=1)
        print(future.result().transform.translation.x, future.result().header.frame_id, future.result().child_frame_id)
        print(buffer.lookup_transform("map", "laser", Time(seconds=10.5)).transform.translation.x)
        asked = "laser", Time(seconds=11), "laser", Time(seconds=10), "map"
        print(buffer.lookup_transform_full(*asked).transform.translation.x)
        print(buffer.can_transform("map", "nothing", Time(), return_debug_tuple=True)[0])
        print(buffer.can_transform("map", "nothing", Time(), timeout=Duration(seconds=0.05)))
        print(buffer.get_latest_common_time("map", "laser").nanoseconds)
        assert (DEFAULT_TF_TOPIC, DEFAULT_STATIC_TF_TOPIC) == ("/tf", "/tf_static")
        other = TransformListener(Buffer(), node, tf_topic="/other", tf_static_topic="other_static")
        assert [one.topic_name for one in (other.tf_sub, other.tf_static_sub)] == ["/other", "/other_static"]
        other.unregister()
        print(sorted(buffer.all_frames_as_string().splitlines()))
        for asked in (("map", "nothing", 0), ("map", "base", 20), ("map", "base", 5), ("map", "", 0)):
            try:
                buffer.lookup_transform(asked[0], asked[1], Time(seconds=asked[2]))
            except tf2_ros.TransformException as error:
                print(type(error).__name__, str(error).partition(". ")[0] if "extrap" in str(error) else "")
        buffer.set_transform(at("map", "alone", 3.0), "me")
        print(isinstance(buffer, Same), tf2_ros.LookupException.__bases__)
        print("broadcaster: 'me'" in buffer.all_frames_as_yaml())
        try:
            buffer.transform(PointStamped(), "map")
        except tf2_ros.TypeException:
            print("not registered")
        def moved(point, how): return point.point.x, how.transform.translation.x
        tf2_ros.TransformRegistration().add(PointStamped, moved)
        point = PointStamped()
        point.header.frame_id = "laser"
        print(buffer.transform(point, "base"))
        listener.unregister()
        rclpy.shutdown()
    """
    assert output_lines(tmp_path, text) == [
        "11.0 map laser",
        "6.0",
        "-10.0",
        "False",
        "False",
        "11000000000",
        "['Frame base exists with parent map.', 'Frame camera exists with parent base.', "
        "'Frame laser exists with parent base.', 'Frame map exists with parent NO_PARENT.']",
        "LookupException ",
        "ExtrapolationException Lookup would require extrapolation into the future",
        "ExtrapolationException Lookup would require extrapolation into the past",
        "InvalidArgumentException ",
        "True (<class 'tf2_py.TransformException'>,)",
        "True",
        "not registered",
        "(0.0, 1.0)",
    ]
