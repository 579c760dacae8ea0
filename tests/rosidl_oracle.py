"""The real rosidl tool chain as a process that answers questions, and the comparison with our parser."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path
from typing import Any

from compiler_worlds import read

from rosidl_py_gen.names import split_ros_name
from rosidl_py_gen.spec.model import ActionDef, ConstantDef, FieldDef, Interface, MessageDef, ServiceDef

_SERVER = Path(__file__).parent / "spec" / "rosidl_server.py"
PYTHON = "/usr/bin/python3"  # Debian's rosidl modules belong to the system interpreter
NEEDED = "import em, rosidl_adapter, rosidl_parser"


class Rosidl:
    """Asks the tool chain; see rosidl_server.py."""

    def __init__(self) -> None:
        command = [PYTHON, str(_SERVER)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )

    def read(self, text: str, name: str = "a_msgs/msg/Sample", format: str = "") -> list[dict[str, Any]] | str:
        """The messages the tool chain reads from a definition, or why it refuses it."""
        package, kind, stem = split_ros_name(name)
        request = {"package": package, "kind": kind, "name": stem, "format": format or kind, "text": text}
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        assert line, "the rosidl process ended"
        reply: dict[str, Any] = json.loads(line)
        messages: list[dict[str, Any]] | None = reply.get("messages")
        return str(reply["refused"]) if messages is None else messages

    def close(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(timeout=10)


_EMPTY = [["structure_needs_at_least_one_member", [3, 0, 0, ""], None]]
_CHAR = {
    "char": "uint8",
    "byte": "octet",
    "bool": "boolean",
    "float32": "float",
    "float64": "double",
    "wstring": "string",
}


def authored(interface: Interface) -> tuple[MessageDef, ...]:
    """The messages an author wrote, without the derived ones."""
    match interface:
        case MessageDef():
            return (interface,)
        case ServiceDef():
            return interface.request, interface.response
        case ActionDef():
            return interface.goal, interface.result, interface.feedback


def plain(interface: Interface) -> list[dict[str, Any]]:
    """Our model in the form the oracle answers in."""
    return [
        {
            "fields": [_field(item) for item in one.fields] or _EMPTY,
            "constants": [_constant(item) for item in one.constants],
        }
        for one in authored(interface)
    ]


def _field(item: FieldDef) -> list[Any]:
    row = list(item.type.description().values())
    default = item.default
    if isinstance(default, tuple):
        return [item.name, row, {"value": [_floaty(value) for value in default]}]
    return [item.name, row, None if default is None else {"value": _floaty(default)}]


def _constant(item: ConstantDef) -> list[Any]:
    return [item.name, _CHAR.get(item.type.base, item.type.base), _floaty(item.value)]


def _floaty(value: Any) -> Any:
    """What the reference makes of infinities and NaN: text without the sign (protocol.md 1.4)."""
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf"
    return value


def compare(rosidl: Rosidl, text: str, name: str = "a_msgs/msg/Sample", format: str = "") -> None:
    theirs = rosidl.read(text, name, format)
    ours, problems = read(text, name, format)
    if isinstance(theirs, str):
        assert problems, f"accepted {text!r}, which rosidl refuses: {theirs}"
        return
    assert not problems, f"refused {text!r}, which rosidl accepts: {problems}"
    assert ours is not None
    assert repr(plain(ours)) == repr(theirs)  # repr: True is not 1, and -0.0 not 0.0
