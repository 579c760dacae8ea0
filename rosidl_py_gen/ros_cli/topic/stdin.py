"""Reading of documents from standard input, each as soon as it is complete.

A document ends at a line ``---``, as ``topic echo`` prints it, or at the end of a line of JSON, as with ``--json``.
"""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from collections.abc import AsyncGenerator
from concurrent.futures import CancelledError

from rosidl_py_gen.ros_cli.command_support import CommandError
from rosidl_py_gen.ros_cli.values import MAX_JSON, MAX_TEXT

_CHUNK_BYTES = 1 << 16
_MAX_QUEUED_CHUNKS = 16


async def documents() -> AsyncGenerator[str, None]:
    """Yield the text of each document that is not empty; raises `CommandError` if it is too long or not UTF-8."""
    lines: list[str] = []
    length = 0
    async for line in _lines():
        if line.startswith(("---", "...")) and not line.strip("-. \t"):
            if lines:
                yield "\n".join(lines) + "\n"
            lines, length = [], 0
        elif not lines and line.startswith("{") and line.endswith("}"):
            yield line
        elif line.strip() or lines:
            lines.append(line)
            length += len(line) + 1
            if length > MAX_TEXT:
                raise CommandError(f"standard input: a document of more than {MAX_TEXT} characters")
    if lines:
        yield "\n".join(lines) + "\n"


async def _lines() -> AsyncGenerator[str, None]:
    incomplete: list[bytes] = []
    length = 0
    async for data in _chunks():
        first, *more = data.split(b"\n")
        incomplete.append(first)
        length += len(first)
        for line in more:
            yield _text(b"".join(incomplete))
            incomplete, length = [line], len(line)
        if length > MAX_JSON:
            raise CommandError(f"standard input: a line of more than {MAX_JSON} bytes")
    if length:
        yield _text(b"".join(incomplete))


def _text(line: bytes) -> str:
    try:
        return line.decode().rstrip("\r")
    except UnicodeDecodeError as error:
        raise CommandError(f"standard input is not UTF-8: {error}") from None


async def _chunks() -> AsyncGenerator[bytes, None]:
    """Yield chunks of bytes from standard input, read by a daemon thread, as an event loop cannot watch a file."""
    if sys.stdin is None or sys.stdin.closed:
        raise CommandError("standard input is closed; expected documents of YAML or JSON there")
    loop, queue = asyncio.get_running_loop(), asyncio.Queue[bytes | OSError](_MAX_QUEUED_CHUNKS)
    file = os.fdopen(os.dup(sys.stdin.fileno()), "rb", buffering=0)  # the thread may read after the command has ended

    def read() -> None:
        data: bytes | OSError = b"?"
        with file:
            while data and isinstance(data, bytes):
                try:
                    data = os.read(file.fileno(), _CHUNK_BYTES)
                except OSError as error:
                    data = error
                enqueue = queue.put(data)
                try:
                    asyncio.run_coroutine_threadsafe(enqueue, loop).result()
                except (RuntimeError, CancelledError):  # the loop is closed, or about to be
                    enqueue.close()
                    return

    threading.Thread(target=read, name="rosidl-py-stdin", daemon=True).start()
    while True:
        data = await queue.get()
        if isinstance(data, OSError):
            raise CommandError(f"standard input: {data.strerror}")
        if not data:
            return
        yield data
