"""The services of rosbag2's recorder: ``~/pause`` and others, of rosbag2_interfaces.

Decides nothing: they do what keys and options do. The definitions are those of the package, which need not be
installed here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.ros_cli.recording.recorder import Recorder
    from rosidl_py_gen.runtime import Node

_PACKAGE = "rosbag2_interfaces"
_NOTHING = "---\n"
_DEFINITIONS = {
    "IsPaused": "---\nbool paused\n",
    "Pause": _NOTHING,
    "Resume": _NOTHING,
    "Snapshot": "---\nbool success\n",
    "SplitBagfile": _NOTHING,
    "TogglePaused": _NOTHING,
}


def serve(node: Node, recorder: Recorder, *, snapshots: bool) -> None:
    """Offer the services of a recorder, as long as the node is there; ``~/snapshot`` only where it has `snapshots`."""

    def add(name: str, kind: str, answer: Callable[[], dict[str, Any] | None]) -> None:
        cls: Any = compile_definition(f"{_PACKAGE}/srv/{kind}", _DEFINITIONS[kind])
        node.create_service(cls, f"~/{name}", lambda request: cls.Response(**(answer() or {})))

    add("pause", "Pause", recorder.pause)
    add("resume", "Resume", recorder.resume)
    add("toggle_paused", "TogglePaused", recorder.toggle_paused)
    add("is_paused", "IsPaused", lambda: {"paused": recorder.is_paused})
    add("split_bagfile", "SplitBagfile", recorder.split)
    if snapshots:
        add("snapshot", "Snapshot", lambda: {"success": recorder.snapshot()})
