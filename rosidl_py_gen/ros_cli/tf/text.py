"""Frames as text for people, as Mermaid and as JSON. Names of peers are not trusted: what these read is escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.output import json_text
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals, FrameStatistics, sources

if TYPE_CHECKING:
    from collections.abc import Iterator


def facts(frame: FrameArrivals, names: dict[Any, str]) -> str:
    """How often, how late, from whom."""
    parts = ["static"] if frame.is_static else []
    if not frame.is_static and (rate := frame.rate_hz) is not None:
        parts.append(f"{rate:.1f} Hz")
    elif not frame.is_static:
        parts.append("once")
    if (delay := frame.delay_s) is not None:
        parts.append(f"{delay[0]:.3f} s late")
    return ", ".join([*parts, *sources(frame, names)])


def lines(frames: FrameStatistics, names: dict[Any, str]) -> Iterator[tuple[str, str]]:
    """A line for each frame, with a style of rich."""
    rows = []
    for name, frame, last in frames.walk():
        marks = "".join("   " if one else "│  " for one in last[:-1])
        branch = "" if frame is None else "└─ " if last[-1] else "├─ "
        rows.append((f"{marks}{branch}{name}", "" if frame is None else facts(frame, names)))
    width = min(max((len(row[0]) for row in rows), default=0), _MOST_COLUMNS)
    for tree, told in rows:
        yield f"{tree:<{width}}  {told}".rstrip(), "" if told else "bold"
    if not rows and not frames.frames:
        yield "no transforms", ""


_MOST_COLUMNS = 60


def problems(frames: FrameStatistics) -> Iterator[str]:
    """What is wrong with the whole."""
    roots = frames.roots()
    if len(roots) > 1:
        yield f"{len(roots)} trees, between which nothing is known: {', '.join(roots[:20])}"
    if loop := frames.frames_in_cycles():
        yield f"frames that form a loop, or are below one: {', '.join(loop[:20])}"
    for frame in frames.frames.values():
        if len(frame.sources) > 1 and not frame.is_static:
            yield f"{frame.name} comes from {len(frame.sources)} publishers"


def mermaid(frames: FrameStatistics, names: dict[Any, str]) -> str:
    """A flowchart from top to bottom; what is told of a frame stands at the arrow that leads to it."""
    every = sorted({*frames.frames, *(frame.parent for frame in frames.frames.values())})
    ids = {name: f"f{number}" for number, name in enumerate(every)}
    out = ["flowchart TD"]
    out += [f'  {mark}["{terminal_output.mermaid_label(name)}"]' for name, mark in ids.items()]
    for frame in sorted(frames.frames.values(), key=lambda one: one.name):
        line = "-.->" if frame.is_static else "-->"
        told = terminal_output.mermaid_label(facts(frame, names))
        out.append(f'  {ids[frame.parent]} {line}|"{told}"| {ids[frame.name]}')
    return "\n".join(out) + "\n"


def plain(frame: FrameArrivals, names: dict[Any, str]) -> dict[str, Any]:
    """A frame for programs."""
    delay = frame.delay_s
    return {
        "frame": frame.name,
        "parent": frame.parent,
        "static": frame.is_static,
        "count": frame.count,
        "rate_hz": None if frame.is_static else frame.rate_hz,
        "delay_s": None if delay is None else {"mean": delay[0], "max": delay[1]},
        "publishers": sources(frame, names),
    }


def as_json(frames: FrameStatistics, names: dict[Any, str]) -> str:
    """One object: the roots, and all other frames."""
    found = [plain(frame, names) for frame in sorted(frames.frames.values(), key=lambda one: one.name)]
    return json_text({"roots": frames.roots(), "frames": found}, indent=2) + "\n"
