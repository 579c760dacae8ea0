"""Image messages of a bag for the commands ``bag images`` and ``bag video``, and the count of skipped images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rosidl_py_gen.bags import BagMessage, BagReader, BagTopic

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
_KINDS = (IMAGE, COMPRESSED, "sensor_msgs/Image", "sensor_msgs/CompressedImage")


class ImageMessages:
    """Selected image messages of an open bag.

    Attributes:
        topics: names of the topics with images.
        other_topics: number of the topics of other types.

    Raises:
        CommandError: one of `topics` has no images, or the bag has none.
    """

    def __init__(self, reader: BagReader, topics: Sequence[str], offset_s: float, duration_s: float | None) -> None:
        from rosidl_py_gen.ros_cli.bag.selection import select_part

        self._reader = reader
        self._part = select_part(reader, topics, offset_s, duration_s)
        self.topics = sorted({one.name for one in reader.channels if one.type_name in _KINDS} & {*self._part.topics})
        others = sorted({*self._part.topics} - {*self.topics})
        self.other_topics = len(others)
        if others and topics:
            found = reader.topics[others[0]].type_name
            raise CommandError(f"{reader.path}: {others[0]} has messages of {found}; expected {IMAGE} or {COMPRESSED}")
        if not self.topics:
            raise CommandError(f"{reader.path} has no topic of {IMAGE} or {COMPRESSED}")
        self._skipped: dict[tuple[str, str], tuple[int, str]] = {}
        for channel in reader.channels:
            if channel.name in self.topics:
                self._require_definition(channel, is_selected=bool(topics))

    def _require_definition(self, channel: BagTopic, is_selected: bool) -> None:
        """Check the definition of a topic.

        If it cannot be used, exclude the topic, or raise the error if the user selected the topic.
        """
        try:
            self._reader.definition(channel)
        except RosidlError as error:
            if is_selected:
                raise
            self.topics.remove(channel.name)
            self._skipped[channel.name, ""] = channel.count or 0, str(error)

    def first_times(self, count: int) -> list[int]:
        """Return the log times of the first images, of which some may be damaged."""
        times = []
        for message in self._reader.raw_messages(self.topics, start_ns=self._part.start_ns, end_ns=self._part.end_ns):
            times.append(message.log_time)
            if len(times) == count:
                break
        return times

    def __iter__(self) -> Iterator[BagMessage]:
        from rosidl_py_gen.ros_cli.bag.display import ProgressBar

        part, channels = self._part, self._reader.channels
        total = sum(one.count or 0 for one in channels if one.name in self.topics) * part.part_of(self._reader)
        messages = self._reader.messages(self.topics, start_ns=part.start_ns, end_ns=part.end_ns, on_error="skip")
        with ProgressBar("messages") as show:
            for item in show.each(messages, total):
                found = item.message._TYPE.name
                if found in (IMAGE, COMPRESSED):
                    yield item
                else:
                    self._count(item.topic, "", f"messages of {found}")

    def skip(self, item: BagMessage, error: RosidlError) -> None:
        """Count an image that cannot be converted."""
        field = str(error).partition(":")[0]
        self._count(item.topic, field, f"the first at {item.log_time} ns: {error}")

    def _count(self, topic: str, kind: str, reason: str) -> None:
        count, first = self._skipped.get((topic, kind), (0, reason))
        self._skipped[topic, kind] = count + 1, first

    def skipped_rows(self) -> list[dict[str, Any]]:
        """Return topic, number and reason of skipped images as rows.

        Images of one topic with an error at the same field share a row.
        """
        rows = [(topic, *skipped) for (topic, _), skipped in self._skipped.items()]
        rows += [(topic, one.count, one.reason) for topic, one in self._reader.skipped.items()]
        return [{"topic": topic, "images": count, "reason": reason} for topic, count, reason in rows]

    def note_skipped(self) -> None:
        """Print a note about the images that were skipped."""
        for row in self.skipped_rows():
            terminal_output.note(f"{row['topic']}: {pluralize(row['images'], 'image')} skipped: {row['reason']}")
        if self.other_topics:
            terminal_output.note(f"{pluralize(self.other_topics, 'topic')} of other types skipped")
