"""The counts that CI prints with each change (`tools/counts.py`)."""

from __future__ import annotations

from counts import counts

READER = """\
import rosidl_py_gen.numpy
from rosidl_py_gen import runtime
from rosidl_py_gen.cdr.codec import decode, encode
from .common import names

class Reader:
    \"\"\"Reader.\"\"\"

    # Not counted.
    def open(self, file):
        self._file = file._raw
        return self._file
"""
RECORD = """\
# docs/reference/api/node.md
class runtime.Node
    __init__(name: str)
    (with)
    async def close() -> None
    def get_name(full: bool = ...) -> str
    def get_name() -> str
    name: str
class runtime.Other
    name: str

# rosidl-py --help
rosidl-py run
    PROGRAM
    -c, --check
"""
TREE = {
    "rosidl_py_gen/bags/reader.py": READER,
    "rosidl_py_gen/bags/writer.py": "from rosidl_py_gen.cdr.codec import encode\n_raw = encode._replace()\n",
    "rosidl_py_gen/cdr/__init__.pyi": "from rosidl_py_gen.cdr.codec import encode as encode\n# not public\n",
    "rosidl_py_gen/ros_compat/rclpy/node.py": "from rosidl_py_gen.runtime.node import Node\n",
    "rosidl_py_gen/msgs/std_msgs/__init__.py": "from rosidl_py_gen.cdr.message import Message\n",
    "templates/message.py.jinja": "class {{ name }}:\n\n    pass\n",
    "tests/support/world.py": "WORLD = 1\n",
    "tests/bags/test_reader.py": "def test_one(): ...\n\n\nasync def test_two(): ...\n",
    "tests/golden/public_face.txt": RECORD,
    "tools/counts.py": "ONE = 1\n",
}


def test_counts_of_a_tree() -> None:
    assert counts(TREE) == {
        "doors: names that another room imports": 3,
        "doors: of these neither public nor generated": 2,
        "doors: modules that another room imports": 2,
        "doors: names that ros_compat imports": 1,
        "private names of other modules: uses": 1,
        "private names of other modules: names": 1,
        "members of Node": 3,
        "options of commands": 1,
        "commands": 1,
        "public face: lines": 12,
        "product: files": 5,
        "product: lines": READER.count("\n") + 8,
        "product: lines of code": 14,
        "tests: files": 2,
        "tests: lines": 5,
        "tests: functions": 2,
        "tools: lines": 1,
        "tests: lines of support": 1,
    }
