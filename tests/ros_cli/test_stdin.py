"""Thread of ``ros_cli/topic/stdin.py``, which may read after the command has ended."""

from __future__ import annotations

import asyncio
import os
import sys
import threading
from contextlib import aclosing
from typing import TYPE_CHECKING

import pytest

from rosidl_py_gen.ros_cli.topic import stdin

if TYPE_CHECKING:
    from pathlib import Path


def test_a_thread_that_reads_on_reads_no_other_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "first").write_text('{"data": "a"}\n')
    (tmp_path / "second").write_bytes(b"of somebody else")
    read, go_on = os.read, threading.Event()
    reads: list[bytes] = []
    before = set(threading.enumerate())

    def late_read(number: int, size: int) -> bytes:
        thread = threading.current_thread()
        if thread.name != "rosidl-py-stdin" or thread in before:
            return read(number, size)
        if reads:
            go_on.wait(10)
        reads.append(read(number, size))
        return reads[-1]

    async def first_document() -> str:
        async with aclosing(stdin.documents()) as documents:
            return await anext(documents)

    monkeypatch.setattr(os, "read", late_read)
    with open(tmp_path / "first", "rb") as file:
        monkeypatch.setattr(sys, "stdin", file)
        assert asyncio.run(first_document()) == '{"data": "a"}'
    (thread,) = (one for one in {*threading.enumerate()} - before if one.name == "rosidl-py-stdin")
    with open(tmp_path / "second", "rb") as other:
        go_on.set()
        thread.join(10)
        assert other.read() == b"of somebody else"
    assert reads == [b'{"data": "a"}\n', b""]
