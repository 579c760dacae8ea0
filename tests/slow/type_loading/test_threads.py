"""Classes that several threads import and look up for the first time at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from support.folders import ROOT

PACKAGE = """<package format="3"><name>threads_msgs</name><version>1.0.0</version><description>d</description>
<maintainer email="a@b.c">m</maintainer><license>x</license><member_of_group>rosidl_interface_packages</member_of_group>
</package>"""
DEFINITIONS = {
    "Stamp.msg": "int32 sec\nuint32 nanosec\n",
    "Inner.msg": "uint8 number\nfloat64[2] values\n",
    "Middle.msg": "Stamp stamp\nInner[] inner\nstring name\n",
    "Outer.msg": "Middle middle\nInner single\nuint16[] numbers\n",
}
PROGRAM = """
import faulthandler, importlib, sys, threading
faulthandler.dump_traceback_later(60, exit=True)
sys.setswitchinterval(1e-6)
from concurrent.futures import ThreadPoolExecutor
from rosidl_py_gen import get_message, install_import_hook
api, path, names = sys.argv[1], sys.argv[2], sys.argv[3].split()
install_import_hook(message_api=api, path=[path])
barrier = threading.Barrier(8)

def work(number):
    barrier.wait()
    found = {}
    for name in names[number % 2 :] + names[: number % 2]:  # in two orders
        if number % 4 == 3 and api == "native":
            found[name] = get_message(f"threads_msgs/msg/{name}", path=[path])
        else:
            found[name] = getattr(importlib.import_module("threads_msgs.msg"), name)
    message = found["Outer"]()
    message.middle.name, message.numbers = "abc", [1, 2, 3]
    message.middle.inner = [found["Inner"](number=7)]
    data = message.encode()
    assert found["Outer"].decode(data) == message
    return {name: id(cls) for name, cls in found.items()}, data.hex()

with ThreadPoolExecutor(8) as pool:
    results = list(pool.map(work, range(8)))
assert all(one == results[0] for one in results), results
print(results[0][1])
"""


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    folder = tmp_path / "threads_msgs"
    (folder / "msg").mkdir(parents=True)
    (folder / "package.xml").write_text(PACKAGE)
    for name, text in DEFINITIONS.items():
        (folder / "msg" / name).write_text(text)
    return tmp_path


def run(program: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("api", ["native", "rclpy"])
def test_threads_that_import_new_types_in_a_process_share_the_classes(api: str, workspace: Path) -> None:
    for _ in range(2):
        done = run(PROGRAM, api, workspace, "Inner Middle Outer")
        assert (done.returncode, done.stderr) == (0, "")
        assert len(bytes.fromhex(done.stdout)) > 60 and "61626300" in done.stdout


BOTH_WAYS = """
import faulthandler, sys, threading
faulthandler.dump_traceback_later(60, exit=True)
sys.setswitchinterval(1e-6)
sys.path.insert(0, sys.argv[1])
from rosidl_py_gen import get_message, install_import_hook
install_import_hook()
import sensor_msgs.msg
names = ["Imu", "JointState", "Image", "LaserScan", "Range", "CameraInfo", "Joy", "Temperature", "MagneticField"]
barrier = threading.Barrier(2)

def look_up():
    barrier.wait()
    for name in names:
        get_message(f"sensor_msgs/msg/{name}")

def import_classes():
    barrier.wait()
    for name in names:
        getattr(sensor_msgs.msg, name)

threads = [threading.Thread(target=one) for one in (look_up, import_classes)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
print([get_message(f"sensor_msgs/msg/{name}") is getattr(sensor_msgs.msg, name) for name in names] == [True] * 9)
"""


def test_lookup_in_a_new_process_does_not_block_an_import_that_needs_it(tmp_path: Path) -> None:
    """A generated package has dependencies from the import hook, whose import needs the lock of the lookup."""
    command = [sys.executable, "-m", "rosidl_py_gen.generator_cli", "--out", str(tmp_path)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    for folder in tmp_path.iterdir():
        if folder.is_dir() and folder.name != "sensor_msgs":
            folder.rename(folder.with_name("unused-" + folder.name))
    for _ in range(4):
        done = run(BOTH_WAYS, tmp_path)
        assert (done.returncode, done.stdout, done.stderr) == (0, "True\n", "")
