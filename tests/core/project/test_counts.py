"""The counts that CI prints with each change (`tools/counts.py`)."""

from __future__ import annotations

import pytest
from counts import PAGE, Listed, Module, counts, listed_names

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
PAGE_TEXT = """
## Private names that other modules use

| Name | Of | Used by | Reason |
|---|---|---|---|
| `_file` | `Reader` | `bags.writer`, `tables` | tests |
| `_raw` | `Reader` | `bags.copy` | tests |
| `_TYPE`, `_encode` | classes | every module | tests |

## Others

| `_other` | `Reader` | `bags` | not in this table |
"""
TREE = {
    "rosidl_py_gen/bags/reader.py": READER,
    "rosidl_py_gen/bags/writer.py": "from rosidl_py_gen.cdr.codec import encode\n_raw = encode._file\n",
    "rosidl_py_gen/bags/copy.py": "from rosidl_py_gen.bags.writer import _raw\n_made = _raw._replace()\n",
    PAGE: PAGE_TEXT,
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
        "private names of other modules: uses": 3,
        "private names of other modules: names": 2,
        "private names of other modules: uses that are not listed": 1,
        "members of Node": 3,
        "options of commands": 1,
        "commands": 1,
        "public face: lines": 12,
        "product: files": 6,
        "product: lines": READER.count("\n") + 10,
        "product: lines of code": 16,
        "tests: files": 2,
        "tests: lines": 5,
        "tests: functions": 2,
        "tools: lines": 1,
        "tests: lines of support": 1,
    }


def test_listed_names_are_those_of_the_first_table() -> None:
    assert listed_names(PAGE_TEXT) == [
        Listed("_file", "bags.writer"),
        Listed("_file", "tables"),
        Listed("_raw", "bags.copy"),
        Listed("_TYPE", ""),
        Listed("_encode", ""),
    ]
    assert listed_names("") == []


@pytest.mark.parametrize(
    ("name", "module", "permitted"),
    [
        ("_file", "bags.writer", True),
        ("_file", "bags.writer.mcap", True),
        ("_file", "bags.writers", False),
        ("_file", "bags", False),
        ("_raw", "bags.writer", False),
    ],
)
def test_listed_name_is_permitted_in_its_module_and_below(name: str, module: str, permitted: bool) -> None:
    assert Listed("_file", "bags.writer").permits(name, module) is permitted


def test_private_names_of_a_module() -> None:
    text = """\
from rosidl_py_gen.cdr.codec import _one, two
from pkg import _three
_own = other._own

class Reader:
    @classmethod
    def made(cls):
        return cls._made or self._made

    def read(self, cls):
        getattr(cls, "_four", None)
        getattr(self, "_read")
        monkeypatch.setattr("rosidl_py_gen.cdr._five", 1)
        return cls._six.__name__, self._read, row._replace(), row._fields, os._exit, file._exit, _
"""
    uses = Module("rosidl_py_gen/bags/reader.py", text).private
    assert [use.text for use in uses] == [
        "rosidl_py_gen.cdr.codec._one",
        "pkg._three",
        "cls._four",
        "rosidl_py_gen.cdr._five",
        "file._exit",
        "cls._six",
    ]
