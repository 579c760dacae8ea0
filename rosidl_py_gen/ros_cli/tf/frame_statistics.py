"""What is known of each frame while one listens: its parent, how often transforms come, how late, and from whom.

Delays are between the stamp and this machine's clock when it came; between the log time and the stamp in recordings.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import NS_PER_S, stamp_ns
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.tf import InvalidTransformError, TransformBuffer, TransformError
from rosidl_py_gen.tf.frame_tree import without_slash

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime import Node

TOPICS = {"/tf": False, "/tf_static": True}
_DEPTH = 100
_MOST_NOTES = 10


@dataclass
class FrameArrivals:
    """A frame that has a parent.

    Attributes:
        arrivals, delays_ns: of the last transforms, ns.
        sources: who sends it: nodes, or what a recording has instead.
    """

    name: str
    parent: str
    is_static: bool
    arrivals: deque[int]
    delays_ns: deque[int]
    sources: set[Any] = field(default_factory=set)
    count: int = 0

    @property
    def rate_hz(self) -> float | None:
        """None before there are two."""
        if len(self.arrivals) < 2 or self.arrivals[-1] <= self.arrivals[0]:
            return None
        return (len(self.arrivals) - 1) * NS_PER_S / (self.arrivals[-1] - self.arrivals[0])

    @property
    def delay_s(self) -> tuple[float, float] | None:
        """The mean and the longest; None for a static frame."""
        if self.is_static or not self.delays_ns:
            return None
        return sum(self.delays_ns) / len(self.delays_ns) / NS_PER_S, max(self.delays_ns) / NS_PER_S


class FrameStatistics:
    """All that were heard of."""

    def __init__(self, window: int = 1000) -> None:
        self._window = window
        self.frames: dict[str, FrameArrivals] = {}
        self.buffer = TransformBuffer()
        self._noted: set[str] = set()

    def add_message(self, message: Any, arrived_ns: int, source: Any, *, static: bool) -> None:
        """Take in a TFMessage; what is no transform is noted once."""
        for one in message.transforms:
            try:
                self.buffer.set_transform(one, static=static)
            except InvalidTransformError as error:
                self._note(f"ignored a transform: {error}")
                continue
            name = without_slash(one.child_frame_id)
            frame = self.frames.get(name)
            if frame is None:
                room = self._window
                frame = self.frames[name] = FrameArrivals(name, "", static, deque(maxlen=room), deque(maxlen=room))
            frame.parent, frame.is_static = without_slash(one.header.frame_id), static
            frame.count += 1
            frame.sources.add(source)
            frame.arrivals.append(arrived_ns)
            frame.delays_ns.append(arrived_ns - stamp_ns(one.header.stamp))

    def _note(self, text: str) -> None:
        if text not in self._noted and len(self._noted) < _MOST_NOTES:
            self._noted.add(text)
            terminal_output.note(text)

    # ------------------------------------------------------------------------------------------------------- the tree

    def children(self) -> dict[str, list[FrameArrivals]]:
        """The frames below each parent, by name."""
        found: dict[str, list[FrameArrivals]] = {}
        for frame in sorted(self.frames.values(), key=lambda one: one.name):
            found.setdefault(frame.parent, []).append(frame)
        return found

    def roots(self) -> list[str]:
        """The frames without a parent, by name."""
        return sorted({frame.parent for frame in self.frames.values()} - self.frames.keys())

    def walk(self) -> Iterator[tuple[str, FrameArrivals | None, tuple[bool, ...]]]:
        """Every frame below its parent: name, what is known of it, and of each level whether it is the last there."""
        children = self.children()
        todo: list[tuple[str, FrameArrivals | None, tuple[bool, ...]]] = [
            (root, None, ()) for root in reversed(self.roots())
        ]
        while todo:
            name, frame, last = todo.pop()
            yield name, frame, last
            below = children.get(name, [])
            # Deeper than anybody looks; the mark of each level would be kept for each frame.
            level = last[-_MOST_LEVELS:]
            todo += [(one.name, one, (*level, one is below[-1])) for one in reversed(below)]

    def frames_in_cycles(self) -> list[str]:
        """Frames that no root leads to, by name."""
        return sorted(self.frames.keys() - {name for name, _, _ in self.walk()})

    def between(self, target: str, source: str) -> list[FrameArrivals]:
        """The frames whose transforms lead from one to the other; raises `TransformError` as a lookup does."""
        self.buffer.lookup_transform(target, source)
        ways = [self._up(target), self._up(source)]
        shared = {one.name for one in ways[0]} & {one.name for one in ways[1]}
        return [one for way in ways for one in way if one.name not in shared]

    def _up(self, name: str) -> list[FrameArrivals]:
        way: list[FrameArrivals] = []
        while (frame := self.frames.get(name)) is not None and len(way) <= len(self.frames):
            way.append(frame)
            name = frame.parent
        return way

    def age_ns(self, target: str, source: str, now_ns: int) -> int | None:
        """How old the newest is that is known of the whole way; None when it is static, or not known."""
        try:
            stamp = self.buffer.lookup_transform(target, source).stamp
        except TransformError:
            return None
        return now_ns - stamp if stamp else None


_MOST_LEVELS = 40


def listeners(node: Node, frames: FrameStatistics, then: Callable[[int], None] = lambda arrived_ns: None) -> list[Any]:
    """What feeds the frames, as coroutines that go on for ever; `then` is called behind each message."""
    cls: Any = get_message("tf2_msgs/msg/TFMessage")

    async def listen(topic: str, qos: QoSProfile, static: bool) -> None:
        subscription = node.create_subscription(cls, topic, qos=qos)
        while True:
            message, info = await subscription.receive_with_info()
            source = (topic, info.publisher_gid)
            frames.add_message(message, info.received_timestamp_ns, source, static=static)
            then(info.received_timestamp_ns)

    profile = QoSProfile(depth=_DEPTH)
    return [listen(topic, profile.transient_local() if static else profile, static) for topic, static in TOPICS.items()]


def sources(frame: FrameArrivals, names: dict[Any, str]) -> list[str]:
    """In words, from `names_of`."""
    return sorted({names.get(one, "(gone)") for one in frame.sources})


def names_of(node: Node) -> dict[Any, str]:
    """The node behind each source."""
    return {
        (topic, one.endpoint_gid): one.node_text for topic in TOPICS for one in node.get_publishers_info_by_topic(topic)
    }
