"""Run the tests of rclpy's companions against ours, file by file.

Run it as ``python tests/support/run_companion_tests.py CHECKOUTS``.

CHECKOUTS is a folder of those of github.com/ros2/common_interfaces, ros2/geometry2 and ros2/message_filters (branch
jazzy), ros-perception/vision_opencv and DLu/tf_transformations, by these names; one that is not there is left out. They
are only read. Like `run_rclpy_tests.py`, it gives each file a process of its own, and keeps nothing of theirs. Those of
cv_bridge and image_geometry need OpenCV; `tostring` of numpy has become `tobytes` in them, and the fields of
CameraInfo are lower case, as in ROS 2.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # for a start by path

from support.run_rclpy_tests import _run

_CONFTEST = """
import sys
from contextlib import nullcontext
from types import ModuleType

from rosidl_py_gen import install_import_hook

sys.argv[1:] = []
install_import_hook(message_api="rclpy", override_installed=True)

import tf2_py

# What loads libraries on Windows, and a tf2_py that was built for its own test.
sys.modules["rpyutils"] = ModuleType("rpyutils")
sys.modules["rpyutils"].add_dll_directories_from_env = lambda name: nullcontext()
sys.modules["test_tf2_py"] = ModuleType("test_tf2_py")
sys.modules["test_tf2_py._tf2_py"] = tf2_py
"""
_FILES = (
    "common_interfaces/sensor_msgs_py/test/test_point_cloud2.py",
    "geometry2/tf2_geometry_msgs/test/test_tf2_geometry_msgs.py",
    "geometry2/tf2_py/test/test_buffer_core.py",
    "geometry2/tf2_ros_py/test/test_buffer.py",
    "geometry2/tf2_ros_py/test/test_buffer_client.py",
    "geometry2/tf2_ros_py/test/test_listener_and_broadcaster.py",
    "geometry2/tf2_sensor_msgs/test/test_tf2_sensor_msgs.py",
    "message_filters/test/directed.py",
    "message_filters/test/test_approxsync.py",
    "message_filters/test/test_message_filters_cache.py",
    "tf_transformations/test/test_transformations.py",
    "vision_opencv/cv_bridge/test/conversions.py",
    "vision_opencv/cv_bridge/test/enumerants.py",
    "vision_opencv/cv_bridge/test/python_bindings.py",
    "vision_opencv/image_geometry/test/directed.py",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkouts", type=Path, help="a folder of checkouts")
    parser.add_argument("--failed", action="store_true", help="print the tests that did not pass, and why")
    parser.add_argument("--timeout", type=float, default=300, help="seconds for one file")
    given = parser.parse_args()
    all_passed = all_tests = 0
    with tempfile.TemporaryDirectory(prefix="companion-tests-") as made:
        Path(made, "conftest.py").write_text(_CONFTEST)
        for name in _FILES:
            source = given.checkouts / name
            if not source.is_file():
                print(f"{name:65} not there")
                continue
            text = source.read_text(encoding="utf-8").replace("tostring()", "tobytes()")
            text = re.sub(r"(?<=[lr]msg\.)[DKPR](?= = )", lambda found: found[0].lower(), text)
            Path(made, source.name).write_text(text, encoding="utf-8")
            count, wrong = _run(Path(made), source.name, given.timeout)
            passed = count - len(wrong)
            all_passed, all_tests = all_passed + passed, all_tests + count
            print(f"{name:65} {passed:3} of {count:3}", flush=True)
            if given.failed:
                print("".join(f"    {test}: {why}\n" for test, why in wrong.items()), end="", flush=True)
    print(f"{'all':65} {all_passed:3} of {all_tests:3}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
