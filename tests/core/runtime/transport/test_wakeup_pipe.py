"""Wakeup pipe with handles of readers that have data."""

from __future__ import annotations

import threading

import pytest

from rosidl_py_gen.runtime.transport.cyclone.endpoints import WakeupPipe


@pytest.mark.parametrize("in_thread", [False, True])
def test_pipe_returns_each_handle_once_in_order_of_first_notification(in_thread: bool) -> None:
    """A peer's graph message must not be read before its discovery, which Cyclone reports first."""
    pipe, handles = WakeupPipe(), [7, 3, 9, 3, 7, 1]
    arrived = threading.Event()
    try:
        for handle in handles:
            pipe.notify(handle)
        if in_thread:
            pipe.read_in_thread(arrived.set)
            assert arrived.wait(10)
        assert [*(pipe.drain() or ())] == [7, 3, 9, 1]
        assert [*(pipe.drain() or ())] == []
    finally:
        pipe.close()
