"""Command ``bag images``, which writes recorded images as picture files, and the image messages of a bag.

``bag video`` reads image messages here, too. Images that are skipped are counted.
"""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import click

from rosidl_py_gen.base.stamps import sec_nanosec
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

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
        from rosidl_py_gen.ros_cli.bag.reading import select_part

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
        from rosidl_py_gen.ros_cli.bag.reading import ProgressBar

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


_SUFFIXES = {"png": ".png", "jpeg": ".jpg"}
_BAD_NAME = {errno.ENAMETOOLONG, errno.ENOTDIR, errno.EEXIST}
"""Operating system errors that a topic's name causes: it is too long for a file, or a folder where another topic has a
file."""
_DEPTH_HEADER_BYTES = 12
"""Size in bytes of the header before the PNG data in messages of compressed_depth_image_transport."""


@click.command("images", cls=options.MultiValueCommand)
@options.bag_path
@click.option(
    *("-o", "--output", "--out", "out"),
    required=True,
    type=click.Path(),
    metavar="DIR",
    help="New or empty output folder.",
)
@options.bag_selection
@click.option(
    "--format",
    "kind",
    type=click.Choice([*_SUFFIXES]),
    default="png",
    show_default=True,
    help="Format of the pictures of sensor_msgs/msg/Image; compressed images keep theirs.",
)
@click.option(
    "--quality",
    type=click.IntRange(1, 95),
    default=95,
    show_default=True,
    metavar="N",
    help="Quality of JPEG files, from 1 to 95.",
)
@options.paths
@options.as_json
@verb
def images(
    path: str,
    out: str,
    topics: Sequence[str],
    offset_s: float,
    duration_s: float | None,
    kind: str,
    quality: int,
    paths: Sequence[str],
    as_json: bool,
) -> int:
    """Write the images of a bag as PNG or JPEG files: DIR/TOPIC/TIME.png with the log time in seconds.

    Files of sensor_msgs/msg/CompressedImage have the recorded bytes. Images that are damaged, or whose encoding the
    format does not support, are skipped and counted; the exit code is 3 then. Needs the extra images.

    \b
    rosidl-py bag images drive --out pictures
    rosidl-py bag images drive --out pictures --topics /camera/image_raw --format jpeg --duration 10
    """
    from rosidl_py_gen.numpy import ConversionError
    from rosidl_py_gen.ros_cli.bag.reading import damaged_rows, opened_bag

    folder = Path(out)
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise CommandError(f"{folder} exists already; expected a new or an empty folder")
    files, written = _Files(folder), Counter[str]()
    with opened_bag(path, search_path=paths) as reader:
        messages = ImageMessages(reader, topics, offset_s, duration_s)
        for item in messages:
            try:
                data, suffix = _picture(item.message, kind, quality)
            except ConversionError as error:
                messages.skip(item, error)
                continue
            try:
                files.write(item, data, suffix)
            except OSError as error:
                if error.errno not in _BAD_NAME:
                    raise
                messages.skip(item, CommandError(f"topic: no file of this name: {error.strerror}"))
                continue
            written[item.topic] += 1
        skipped = messages.skipped_rows()
        if not written and not skipped:
            raise CommandError(f"{path} has no images in the selected part")
        if as_json:
            rows = [{"topic": topic, "images": written[topic]} for topic in messages.topics]
            document: dict[str, Any] = {"path": out, "topics": rows, "skipped": skipped}
            document |= {"other_topics": messages.other_topics, "damaged": damaged_rows(reader.damaged)}
            terminal_output.document(document)
        else:
            messages.note_skipped()
            counts = f"{pluralize(written.total(), 'image')} of {pluralize(len(written), 'topic')}"
            terminal_output.line(f"{counts} in {out}")
        return DAMAGED if skipped or reader.damaged else 0


def _picture(message: Any, kind: str, quality: int) -> tuple[bytes, str]:
    """Return the contents and the suffix of a picture file for an image message; raises `ConversionError`."""
    from rosidl_py_gen.numpy import array_to_compressedimage, image_to_array, reads_message

    if message._TYPE.name == COMPRESSED:
        return reads_message("a sensor_msgs/msg/CompressedImage")(_recorded_picture)(message)
    made: Any = array_to_compressedimage(image_to_array(message), message.encoding, format=kind, quality=quality)
    return made.data.tobytes(), _SUFFIXES[kind]


def _recorded_picture(message: Any) -> tuple[bytes, str]:
    """Return the recorded bytes of a compressed image and the suffix for a file of its format.

    Raises `ConversionError` if the bytes are not a picture, or break off.
    """
    from rosidl_py_gen.numpy import ConversionError, flat_bytes

    data = flat_bytes(message.data, "data").tobytes()
    encoding, _, how = message.format.partition(";")
    if "compressedDepth" in how:
        if "rvl" in how or encoding.strip() == "32FC1":
            raise ConversionError(f"format: {message.format!r:.50} is no picture file; expected 16UC1 as PNG")
        data = data[_DEPTH_HEADER_BYTES:]
    if data[:3] == b"\xff\xd8\xff":
        # Compressed pixels cannot contain these markers: the end of the picture follows the last start of pixels.
        suffix, is_whole = ".jpg", data.rfind(b"\xff\xd9") > data.rfind(b"\xff\xda") > 0
    elif data[:8] == b"\x89PNG\r\n\x1a\n":
        suffix, is_whole = ".png", data.rfind(b"IEND") > 0
    elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        suffix, is_whole = ".webp", len(data) >= 8 + int.from_bytes(data[4:8], "little")
    elif data[:4] in (b"II*\0", b"MM\0*"):
        suffix, is_whole = ".tiff", True
    else:
        raise ConversionError(f"data: {len(data)} bytes are not JPEG, PNG, TIFF or WebP")
    if not is_whole:
        raise ConversionError(f"data: the {suffix[1:]} of {len(data)} bytes breaks off")
    return data, suffix


class _Files:
    """Names of new picture files in a folder: TOPIC/TIME.SUFFIX, with -1, -2 and so on for further images of the same
    time.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._last: dict[Path, tuple[int, int]] = {}  # of each folder: time and number of the newest file

    def write(self, item: BagMessage, data: bytes, suffix: str) -> None:
        """Write an image to a new file; raises `OSError`."""
        names = [quote(name, safe="") for name in item.topic.split("/") if name]
        names = [name.replace(".", "%2E") if set(name) == {"."} else name for name in names]  # leads out of the folder
        target = self._folder.joinpath(*names)
        target.mkdir(parents=True, exist_ok=True)
        seconds, rest = sec_nanosec(item.log_time)
        last_time, last_number = self._last.get(target, (None, 0))
        for number in count(last_number + 1 if last_time == item.log_time else 0):
            # Ten digits of seconds, so that names are in the order of their times.
            path = target / f"{seconds:010d}.{rest:09d}{f'-{number}' if number else ''}{suffix}"
            with suppress(FileExistsError):
                stream = path.open("xb")
                break
        self._last[target] = item.log_time, number
        try:
            with stream:
                stream.write(data)
        except BaseException:
            path.unlink()  # incomplete: the disk is full, or Ctrl-C
            raise
