"""Command ``bag images``: writes recorded images as picture files."""

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
from rosidl_py_gen.ros_cli import DAMAGED, options, terminal_output, verb
from rosidl_py_gen.ros_cli.command_support import CommandError

if TYPE_CHECKING:
    from rosidl_py_gen.bags import BagMessage

_SUFFIXES = {"png": ".png", "jpeg": ".jpg"}
_BAD_NAME = {errno.ENAMETOOLONG, errno.ENOTDIR, errno.EEXIST}
"""Operating system errors that a topic's name causes: it is too long for a file, or a folder where another topic has a
file."""
_DEPTH_HEADER_BYTES = 12
"""Size in bytes of the header before the PNG data in messages of compressed_depth_image_transport."""


@click.command("images", cls=options.MultiValueCommand)
@options.bag_path
@click.option("-o", "--out", required=True, type=click.Path(), metavar="DIR", help="New or empty output folder.")
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
    from rosidl_py_gen.ros_cli.bag.display import damaged_rows, opened_bag
    from rosidl_py_gen.ros_cli.bag.image_messages import ImageMessages

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
    from rosidl_py_gen.numpy import array_to_compressedimage, image_to_array
    from rosidl_py_gen.numpy.common import reads_message
    from rosidl_py_gen.ros_cli.bag.image_messages import COMPRESSED

    if message._TYPE.name == COMPRESSED:
        return reads_message("a sensor_msgs/msg/CompressedImage")(_recorded_picture)(message)
    made: Any = array_to_compressedimage(image_to_array(message), message.encoding, format=kind, quality=quality)
    return made.data.tobytes(), _SUFFIXES[kind]


def _recorded_picture(message: Any) -> tuple[bytes, str]:
    """Return the recorded bytes of a compressed image and the suffix for a file of its format.

    Raises `ConversionError` if the bytes are not a picture, or break off.
    """
    from rosidl_py_gen.numpy import ConversionError
    from rosidl_py_gen.numpy.common import flat_bytes

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
