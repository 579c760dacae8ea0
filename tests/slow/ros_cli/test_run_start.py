"""Start of ``rosidl-py run``: modules are loaded only if needed, and arrays are numpy arrays from the start."""

from __future__ import annotations

import json
import textwrap
import time
from pathlib import Path

import pytest
from support.interface_packages import write
from support.program_processes import output_lines, run

pytestmark = pytest.mark.real_time("programs are processes")
HEAVY = ("numpy", "click", "jinja2", "lark", "yaml", "rosidl_py_gen.compiler.codegen", "importlib.metadata")
TALKER = """
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Talker(Node):
    def __init__(self):
        super().__init__("talker")
        self.declare_parameter("rate", 10.0)
        self.publisher = self.create_publisher(String, "chatter", 10)
        self.subscription = self.create_subscription(String, "chatter", self.received, 10)
        self.timer = self.create_timer(0.01, lambda: self.publisher.publish(String(data="hello")))
        self.texts = []

    def received(self, message):
        self.get_logger().info(message.data)
        self.texts.append(message.data)

rclpy.init()
node = Talker()
while not node.texts:
    rclpy.spin_once(node, timeout_sec=1)
print(node.get_parameter("rate").value, node.texts[0])
node.destroy_node()
rclpy.shutdown()
print([name for name in HEAVY if name in sys.modules])
"""


@pytest.fixture(autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path_factory.mktemp("cache")))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF")


def test_string_talker_loads_neither_numpy_nor_compiler(tmp_path: Path) -> None:
    program = TALKER.replace("HEAVY", repr(HEAVY))
    for number in range(3):
        if number == 1:
            time.sleep(2.1)  # what has changed a moment ago is not cached
        lines = output_lines(tmp_path, program)
        assert lines[0] == "10.0 hello"
        found = json.loads(lines[1].replace("'", '"'))
        assert "numpy" not in found and "click" not in found
        if number == 2:
            assert found == []


def test_fixed_arrays_are_numpy_arrays_from_first_use_on(tmp_path: Path) -> None:
    program = """
        import array, sys
        from rclpy.serialization import deserialize_message, serialize_message
        from sensor_msgs.msg import Imu, LaserScan
        from geometry_msgs.msg import Point32, Polygon
        from std_msgs.msg import String

        scan = LaserScan(ranges=[1.0, 2.0])
        scan.intensities = array.array("f", [3.0])
        polygon = Polygon(points=[Point32(x=1.0)])
        texts = [serialize_message(one) for one in (scan, polygon, String(data="x"))]
        back = deserialize_message(texts[0], LaserScan)
        again = deserialize_message(texts[1], Polygon)
        print(type(back.ranges).__name__, back == scan, again == polygon, "numpy" in sys.modules)
        imu = Imu()
        print("numpy" in sys.modules, type(imu.orientation_covariance).__module__)
        import numpy
        received = deserialize_message(serialize_message(imu), Imu)
        for message in (imu, received):
            assert type(message.orientation_covariance) is numpy.ndarray
            assert message.orientation_covariance.dtype == numpy.float64
            message.orientation_covariance[0] = 5
        assert imu == received and imu != Imu()
        imu.orientation_covariance = [1] * 9
        scan.ranges = numpy.arange(3, dtype=numpy.float32)
        print(serialize_message(imu) != serialize_message(received), scan.ranges)
    """
    assert output_lines(tmp_path, program) == [
        "array True True False",
        "True numpy",
        "True array('f', [0.0, 1.0, 2.0])",
    ]


def test_decoding_arrays_is_independent_of_earlier_numpy_import(tmp_path: Path) -> None:
    program = """
        import sys
        if len(sys.argv) > 1: import numpy
        from rclpy.serialization import deserialize_message
        from sensor_msgs.msg import Imu
        from rclpy.parameter import Parameter
        data = bytes([0, 1, 0, 0]) + bytes(8) + bytes([1, 0, 0, 0]) + bytes(400)
        imu = deserialize_message(data, Imu)
        print(type(imu.linear_acceleration_covariance), imu.linear_acceleration_covariance.flags.writeable)
        print(Parameter("a", value=[True, False]).get_parameter_value().bool_array_value)
    """
    expected = ["<class 'numpy.ndarray'> True", "[True, False]"]
    (tmp_path / "program.py").write_text(textwrap.dedent(program), encoding="utf-8")
    for arguments in ((), ("numpy",)):
        assert run("program.py", *arguments, cwd=tmp_path).stdout.splitlines() == expected


def test_garbage_is_collected_while_a_program_runs(tmp_path: Path) -> None:
    program = """
        import gc, weakref
        class Loop: pass
        def make():
            one = Loop()
            one.itself = one
            return weakref.ref(one)
        reference = make()
        print(gc.isenabled(), gc.collect() > 0, reference() is None)
    """
    assert output_lines(tmp_path, program) == ["True True True"]


# --- message packages that are missing --------------------------------------------------------------------------------

CLONE = "git clone --depth 1 --branch humble https://github.com/ros-controls/control_msgs; then use --path control_msgs"


def test_missing_well_known_package_error_names_its_repository(tmp_path: Path) -> None:
    write(tmp_path, {"program.py": "import os\nfrom control_msgs.msg import JointJog\nprint(JointJog().duration)"})
    found = run("--distro", "humble", "program.py", cwd=tmp_path)
    *frames, last = found.stderr.splitlines()
    assert last.startswith("ModuleNotFoundError: No module named 'control_msgs'. ") and CLONE in last
    assert found.returncode == 1 and len(frames) == 3 and "program.py" in frames[1], frames
    checked = run("--distro", "humble", "--check", "program.py", cwd=tmp_path)
    assert "program.py:2: no package control_msgs. control_msgs is in https://" in checked.stdout
    assert CLONE in checked.stdout


def test_program_can_catch_import_error_of_missing_message_package(tmp_path: Path) -> None:
    program = """
        from importlib.util import find_spec
        print(find_spec("px4_msgs"))
        try:
            import px4_msgs.msg
        except ImportError as error:
            print(type(error).__name__, error.name)
        import sys
        class Later:
            def find_spec(self, name, path=None, target=None):
                from importlib.machinery import ModuleSpec
                return ModuleSpec(name, None, is_package=True) if name == "px4_msgs" else None
        sys.meta_path.append(Later())
        import px4_msgs
        print(px4_msgs.__name__)
    """
    assert output_lines(tmp_path, program) == ["None", "ModuleNotFoundError px4_msgs", "px4_msgs"]
