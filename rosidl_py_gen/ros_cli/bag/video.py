"""Command ``bag video``: writes recorded images as a video of constant frame rate."""

from __future__ import annotations

from contextlib import closing
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import DAMAGED, options, verb

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.ros_cli.bag.images import ImageMessages
    from rosidl_py_gen.ros_cli.bag.video_file import VideoFile

_SUFFIXES = (".mp4", ".mkv", ".mov")
_RATE_SAMPLES = 200
"""Number of images from whose intervals the frame rate is determined, as the median."""
_MAX_HZ = 240


@click.command("video")
@options.bag_path
@click.argument("output", type=click.Path(), metavar="OUT")
@click.option(
    "--topic",
    metavar="TOPIC",
    shell_complete=options.bag_completion("topic"),
    help="Topic with the images; not needed if the bag has one.",
)
@click.option(
    "--fps",
    type=options.FiniteRange(0.01, 1000),
    metavar="HZ",
    help="Frames per second, from 0.01 to 1000.  [default: by the median interval of the first 200 images]",
)
@options.start_offset
@options.duration
@options.paths
@options.as_json
@verb
def video(
    path: str,
    output: str,
    topic: str | None,
    fps: float | None,
    offset_s: float,
    duration_s: float | None,
    paths: Sequence[str],
    as_json: bool,
) -> int:
    """Write the images of a topic as a video: H.264 in a file that ends with .mp4, .mkv or .mov.

    The frame rate is constant, and times are log times: images are repeated or dropped to keep them. Images that are
    damaged or have no colours, for example depths, are skipped and counted; the exit code is 3 then. All images must
    have one size. Needs the extra video.

    \b
    rosidl-py bag video drive --topic /camera/image_raw drive.mp4
    rosidl-py bag video drive front.mp4 --topic /front/image_raw/compressed --fps 10 --start-offset 60 --duration 20
    """
    Extra.require_modules("av")
    from rosidl_py_gen.bags import DurableFile
    from rosidl_py_gen.ros_cli.bag.images import ImageMessages
    from rosidl_py_gen.ros_cli.bag.reading import damaged_rows, opened_bag
    from rosidl_py_gen.ros_cli.bag.video_file import VideoFile

    target = Path(output)
    if target.suffix not in _SUFFIXES:
        raise CommandError(f"{target}: expected a file that ends with {', '.join(_SUFFIXES)}")
    if target.exists():
        raise CommandError(f"{target} exists already")
    file = DurableFile(target)
    if file.partial.exists():
        raise CommandError(f"{file.partial} exists, perhaps of a run that goes on or was killed; remove it")
    with opened_bag(path, search_path=paths) as reader:
        images = ImageMessages(reader, () if topic is None else (topic,), offset_s, duration_s)
        if len(images.topics) > 1:
            raise CommandError(f"{path} has images of {', '.join(images.topics)}; select one with --topic")
        rate = _median_rate(images.first_times(_RATE_SAMPLES)) if fps is None else _fraction(fps)
        with file as partial, closing(VideoFile(partial, rate)) as made:
            _encode(images, made)
        skipped = images.skipped_rows()
        counts = {"frames": made.frames, "images": made.images, "repeated": made.repeated, "dropped": made.dropped}
        if as_json:
            document = {"path": output, "topic": images.topics[0], "fps": float(rate), **counts, "skipped": skipped}
            terminal_output.document({**document, "damaged": damaged_rows(reader.damaged)})
        else:
            images.note_skipped()
            if made.is_padded:
                terminal_output.note("images have an odd size; a row or column is repeated, as H.264 needs even sizes")
            frames = f"{pluralize(made.frames, 'frame')} at {float(rate):g} Hz of {pluralize(made.images, 'image')}"
            terminal_output.line(f"{frames} ({made.repeated} repeated, {made.dropped} dropped) in {output}")
        return DAMAGED if skipped or reader.damaged else 0


def _fraction(hz: float) -> Fraction:
    """Return a frame rate as a fraction with a small denominator, in which form video files store it."""
    return Fraction(hz).limit_denominator(1001)


def _median_rate(times_ns: Sequence[int]) -> Fraction:
    """Return the median rate of images in Hz, rounded to an integer that is within 2 %, because recorders are not
    exact.
    """
    intervals = sorted(later - earlier for earlier, later in pairwise(times_ns))
    hz = Fraction(NS_PER_S, max(1, intervals[(len(intervals) - 1) // 2])) if intervals else Fraction(1)
    if abs(round(hz) - hz) <= hz / 50:
        hz = Fraction(round(hz))
    return min(Fraction(_MAX_HZ), max(Fraction(1, 60), hz.limit_denominator(60)))


def _encode(images: ImageMessages, target: VideoFile) -> None:
    """Write all images to the video.

    Raises `CommandError` if there are none, if their size changes, or if a gap is very long.
    """
    from rosidl_py_gen.numpy import ConversionError, compressedimage_to_array, image_to_array
    from rosidl_py_gen.ros_cli.bag.images import IMAGE

    for item in images:
        convert = image_to_array if item.message._TYPE.name == IMAGE else compressedimage_to_array
        try:
            pixels = convert(item.message, to="rgb8")
            if not pixels.size:
                raise ConversionError(f"width, height: got {pixels.shape[1]} x {pixels.shape[0]}; expected pixels")
        except ConversionError as error:
            images.skip(item, error)
            continue
        if reason := target.mismatch_reason(item.log_time, pixels):
            hint = "select a part with --start-offset and --duration"
            raise CommandError(f"{item.topic} at {item.log_time} ns: {reason}; {hint}")
        target.add(item.log_time, pixels)
    if not target.images:
        images.note_skipped()
        raise CommandError(f"{images.topics[0]} has no image that can be a frame")
    target.finish()
