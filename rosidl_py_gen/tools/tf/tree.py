"""``tf tree``: listen for a while, then show the frames."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from rosidl_py_gen.base.output import printable_line
from rosidl_py_gen.tools import ToolError, printing
from rosidl_py_gen.tools.session import Network, Session, first_of
from rosidl_py_gen.tools.tf import text
from rosidl_py_gen.tools.tf.frames import Frames, listeners, names_of

_ENDINGS = {".png": "png", ".mmd": "mermaid", ".mermaid": "mermaid", ".md": "markdown", ".json": "json", ".txt": "text"}


async def run(network: Network, kind: str | None, as_json: bool, output: str | None, wait_s: float) -> int:
    """What the command does."""
    kind = kind_of(kind, as_json, output)
    frames = Frames()
    async with Session(network) as session:
        await session.wait_until_quiet()
        await first_of(asyncio.sleep(wait_s), *listeners(session.node, frames))
        await session.wait_for(session.node.names_are_known, 1.0)
        names = names_of(session.node)
    await asyncio.to_thread(show, frames, names, kind, output)
    return 0


def kind_of(kind: str | None, as_json: bool, output: str | None) -> str:
    """How it is to be drawn; raises `ToolError` for an ending that does not say."""
    if as_json or kind is not None or output is None:
        found = "json" if as_json else kind or "text"
    else:
        ending = Path(output).suffix.lower()
        if ending not in _ENDINGS:
            raise ToolError(
                f"{output}: the ending says how to draw; expected one of {', '.join(_ENDINGS)}, or --format"
            )
        found = _ENDINGS[ending]
    if found == "png":
        if output is None:
            raise ToolError("a PNG picture is no text; give a file: -o frames.png")
        from rosidl_py_gen.tools.tf import png  # noqa: F401 - what is missing is told before anybody waits
    return found


def show(frames: Frames, names: dict[Any, str], kind: str, output: str | None) -> None:
    """Print it, or write the file."""
    for problem in text.problems(frames):
        printing.note(f"warning: {problem}")
    if kind == "png":
        from rosidl_py_gen.tools.tf import png

        assert output is not None
        png.write(frames, names, Path(output))
    elif output is None and kind == "text":
        for line, style in text.lines(frames, names):
            printing.line(line, style)
    elif output is None:
        printing.block(_drawn(frames, names, kind).rstrip("\n"))
    else:
        Path(output).write_text(_drawn(frames, names, kind), encoding="utf-8")
    if output is not None:
        printing.note(f"wrote {output}: {len(frames.frames) + len(frames.roots())} frames")


def _drawn(frames: Frames, names: dict[Any, str], kind: str) -> str:
    if kind == "json":
        return text.as_json(frames, names)
    if kind == "mermaid":
        return text.mermaid(frames, names)
    if kind == "markdown":
        return f"```mermaid\n{text.mermaid(frames, names)}```\n"
    return "".join(f"{printable_line(line)}\n" for line, _ in text.lines(frames, names))
