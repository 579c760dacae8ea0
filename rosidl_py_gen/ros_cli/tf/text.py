"""Frames as text, Mermaid and JSON. Names of peers are not trusted and therefore escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.terminal_text import json_text
from rosidl_py_gen.ros_cli import terminal_output
from rosidl_py_gen.ros_cli.tf.frame_statistics import FrameArrivals, FrameStatistics, sources

if TYPE_CHECKING:
    from collections.abc import Iterator


_MAX_COLUMNS = 60


def summary(frame: FrameArrivals, names: dict[Any, str]) -> str:
    """Return the rate, the delay and the publishers of a frame."""
    parts = ["static"] if frame.is_static else []
    if not frame.is_static and (rate := frame.rate_hz) is not None:
        parts.append(f"{rate:.1f} Hz")
    elif not frame.is_static:
        parts.append("once")
    if (delay := frame.delay_s) is not None:
        parts.append(f"{delay[0]:.3f} s late")
    return ", ".join([*parts, *sources(frame, names)])


def lines(frames: FrameStatistics, names: dict[Any, str]) -> Iterator[tuple[str, str]]:
    """Yield a line for each frame, and its style of rich."""
    rows = []
    for name, frame, last in frames.walk():
        marks = "".join("   " if one else "│  " for one in last[:-1])
        branch = "" if frame is None else "└─ " if last[-1] else "├─ "
        rows.append((f"{marks}{branch}{name}", "" if frame is None else summary(frame, names)))
    width = min(max((len(row[0]) for row in rows), default=0), _MAX_COLUMNS)
    for tree, text in rows:
        yield f"{tree:<{width}}  {text}".rstrip(), "" if text else "bold"
    if not rows and not frames.frames:
        yield "no transforms", ""


def problems(frames: FrameStatistics) -> Iterator[str]:
    """Yield warnings about the whole tree."""
    roots = frames.roots()
    if len(roots) > 1:
        yield f"{len(roots)} trees that are not connected: {', '.join(roots[:20])}"
    if loop := frames.frames_in_cycles():
        yield f"frames that form a loop, or are below one: {', '.join(loop[:20])}"
    for frame in frames.frames.values():
        if len(frame.sources) > 1 and not frame.is_static:
            yield f"{frame.name} comes from {len(frame.sources)} publishers"


def mermaid(frames: FrameStatistics, names: dict[Any, str]) -> str:
    """Return a flowchart from top to bottom, with the summary of a frame at the arrow to it."""
    every = sorted({*frames.frames, *(frame.parent for frame in frames.frames.values())})
    ids = {name: f"f{number}" for number, name in enumerate(every)}
    out = ["flowchart TD"]
    out += [f'  {mark}["{terminal_output.mermaid_label(name)}"]' for name, mark in ids.items()]
    for frame in sorted(frames.frames.values(), key=lambda one: one.name):
        line = "-.->" if frame.is_static else "-->"
        text = terminal_output.mermaid_label(summary(frame, names))
        out.append(f'  {ids[frame.parent]} {line}|"{text}"| {ids[frame.name]}')
    return "\n".join(out) + "\n"


def plain(frame: FrameArrivals, names: dict[Any, str]) -> dict[str, Any]:
    """Return a frame for JSON."""
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
    """Return a JSON object with the roots and all other frames."""
    rows = [plain(frame, names) for frame in sorted(frames.frames.values(), key=lambda one: one.name)]
    return json_text({"roots": frames.roots(), "frames": rows}, indent=2) + "\n"
