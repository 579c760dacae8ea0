"""Statistics of received transforms: parent, rate, delay and publishers of each frame.

A delay is the arrival time by the clock of this machine minus the stamp; in recordings it is log time minus stamp.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.stamps import NS_PER_S, stamp_ns
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.tf import InvalidTransformError, TransformBuffer, TransformError, without_slash

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rosidl_py_gen.runtime import Node

TOPICS = {"/tf": False, "/tf_static": True}
_DEPTH = 100
_MAX_LEVELS = 40
"""Maximum number of tree levels for which `walk` returns values, so that long chains of frames need little memory."""


@dataclass
class FrameArrivals:
    """Statistics of a frame with a parent: arrival times and delays of its last transforms, in ns.

    `sources` are the publishers of the transforms, or topics of a recording.
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
        """Number of transforms per second; None before the second transform."""
        if len(self.arrivals) < 2 or self.arrivals[-1] <= self.arrivals[0]:
            return None
        return (len(self.arrivals) - 1) * NS_PER_S / (self.arrivals[-1] - self.arrivals[0])

    @property
    def delay_s(self) -> tuple[float, float] | None:
        """Mean and maximum delay of transforms in seconds; None for a static frame."""
        return None if self.is_static else mean_and_max_s(self.delays_ns)

    def publishers(self, names: dict[Any, str]) -> list[str]:
        """Return the sorted node names of the publishers; `names` is a result of `names_of`."""
        return sorted({names.get(one, "(gone)") for one in self.sources})

    def summary(self, names: dict[Any, str]) -> str:
        """Return the rate, the delay and the publishers of the frame as text."""
        parts = ["static"] if self.is_static else ["once"] if self.rate_hz is None else [f"{self.rate_hz:.1f} Hz"]
        if (delay := self.delay_s) is not None:
            parts.append(f"{delay[0]:.3f} s late")
        return ", ".join([*parts, *self.publishers(names)])

    def row(self, names: dict[Any, str]) -> dict[str, Any]:
        """Return the statistics of the frame as a row for JSON."""
        delay = self.delay_s
        return {
            "frame": self.name,
            "parent": self.parent,
            "static": self.is_static,
            "count": self.count,
            "rate_hz": None if self.is_static else self.rate_hz,
            "delay_s": None if delay is None else {"mean": delay[0], "max": delay[1]},
            "publishers": self.publishers(names),
        }


def mean_and_max_s(values_ns: deque[int]) -> tuple[float, float] | None:
    """Return mean and maximum of values in seconds; None if there are no values."""
    return (sum(values_ns) / len(values_ns) / NS_PER_S, max(values_ns) / NS_PER_S) if values_ns else None


class FrameStatistics:
    """Statistics of all frames in received transforms."""

    def __init__(self, window: int = 1000) -> None:
        self._window = window
        self.frames: dict[str, FrameArrivals] = {}
        self.buffer = TransformBuffer()
        self._note = terminal_output.OnceNotes()

    def add_message(self, message: Any, arrived_ns: int, source: Any, *, static: bool) -> None:
        """Add the transforms of a TFMessage; each kind of invalid transform is noted once."""
        for one in message.transforms:
            try:
                self.buffer.set_transform(one, static=static)
            except InvalidTransformError as error:
                self._note(f"ignored a transform: {error}")
                continue
            name = without_slash(one.child_frame_id)
            frame = self.frames.get(name)
            if frame is None:
                arrivals, delays_ns = deque[int](maxlen=self._window), deque[int](maxlen=self._window)
                frame = self.frames[name] = FrameArrivals(name, "", static, arrivals, delays_ns)
            frame.parent, frame.is_static = without_slash(one.header.frame_id), static
            frame.count += 1
            frame.sources.add(source)
            frame.arrivals.append(arrived_ns)
            frame.delays_ns.append(arrived_ns - stamp_ns(one.header.stamp))

    def children(self) -> dict[str, list[FrameArrivals]]:
        """Return the child frames of each parent, sorted by name."""
        children: dict[str, list[FrameArrivals]] = {}
        for frame in sorted(self.frames.values(), key=lambda one: one.name):
            children.setdefault(frame.parent, []).append(frame)
        return children

    def roots(self) -> list[str]:
        """Return the sorted names of frames without a parent."""
        return sorted({frame.parent for frame in self.frames.values()} - self.frames.keys())

    def walk(self) -> Iterator[tuple[str, FrameArrivals | None, tuple[bool, ...]]]:
        """Yield each frame after its parent: name, statistics, and for each level True if the frame on it is the last
        child there.
        """
        children = self.children()
        todo: list[tuple[str, FrameArrivals | None, tuple[bool, ...]]] = [
            (root, None, ()) for root in reversed(self.roots())
        ]
        while todo:
            name, frame, last = todo.pop()
            yield name, frame, last
            below = children.get(name, [])
            level = last[-_MAX_LEVELS:]
            todo += [(one.name, one, (*level, one is below[-1])) for one in reversed(below)]

    def frames_in_cycles(self) -> list[str]:
        """Return the sorted names of frames that are in a cycle, or below a frame in a cycle."""
        return sorted(self.frames.keys() - {name for name, _, _ in self.walk()})

    def between(self, target: str, source: str) -> list[FrameArrivals]:
        """Return the frames on the path between two frames; raises `TransformError` if there is no transform."""
        self.buffer.lookup_transform(target, source)
        paths = [self._path_to_root(target), self._path_to_root(source)]
        shared = {one.name for one in paths[0]} & {one.name for one in paths[1]}
        return [one for path in paths for one in path if one.name not in shared]

    def _path_to_root(self, name: str) -> list[FrameArrivals]:
        path: list[FrameArrivals] = []
        while (frame := self.frames.get(name)) is not None and len(path) <= len(self.frames):
            path.append(frame)
            name = frame.parent
        return path

    def age_ns(self, target: str, source: str, now_ns: int) -> int | None:
        """Return the age of the newest transform between two frames at `now_ns`; None if static or unknown."""
        try:
            stamp = self.buffer.lookup_transform(target, source).stamp
        except TransformError:
            return None
        return now_ns - stamp if stamp else None


def listeners(node: Node, frames: FrameStatistics, then: Callable[[int], None] = lambda arrived_ns: None) -> list[Any]:
    """Return coroutines that add received transforms to `frames` until they are cancelled, and call `then` after each
    message.
    """
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


def names_of(node: Node) -> dict[Any, str]:
    """Return the node name of each publisher of transforms, by topic and GID."""
    return {
        (topic, one.endpoint_gid): one.node_text for topic in TOPICS for one in node.get_publishers_info_by_topic(topic)
    }
