"""``tf tree --bag``: the frames of a recording, at its end."""

from __future__ import annotations

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.tools import ToolError
from rosidl_py_gen.tools.tf.frames import Frames
from rosidl_py_gen.tools.tf.tree import kind_of, show

_TYPE = "tf2_msgs/msg/TFMessage"


def run(path: str, kind: str | None, as_json: bool, output: str | None) -> int:
    """What the command does."""
    kind = kind_of(kind, as_json, output)
    frames = Frames(window=10_000)
    with BagReader(path) as reader:
        topics = [name for name, topic in reader.topics.items() if topic.type_name == _TYPE]
        if not topics:
            raise ToolError(f"{path} has no topic of {_TYPE}")
        for one in reader.messages(topics):
            frames.take(one.message, one.log_time, one.topic, static=one.topic.endswith("/tf_static"))
        show(frames, {name: name for name in topics}, kind, output)
    return 0
