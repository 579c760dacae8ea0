"""SIGINT in a process that runs a command."""

from __future__ import annotations

import os
import signal
import time

import pytest

from rosidl_py_gen.base.interrupts import REPEAT_S, CommandInterrupts


class ExitedError(Exception):
    """Raised instead of calling `os._exit`."""


def test_first_ctrl_c_raises_keyboard_interrupt_and_a_late_second_ctrl_c_exits(monkeypatch: pytest.MonkeyPatch) -> None:
    def exit_now(code: int) -> None:
        raise ExitedError(code)

    now_s = 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    monkeypatch.setattr(os, "_exit", exit_now)
    before = signal.getsignal(signal.SIGINT)
    try:
        handler = CommandInterrupts()
        with pytest.raises(KeyboardInterrupt), handler.handling(is_process=True):
            signal.raise_signal(signal.SIGINT)
        now_s += REPEAT_S / 2
        signal.raise_signal(signal.SIGINT)
        now_s += REPEAT_S
        with pytest.raises(ExitedError, match="130"):
            signal.raise_signal(signal.SIGINT)
        done = CommandInterrupts()
        with done.handling(is_process=True):
            pass
        signal.raise_signal(signal.SIGINT)  # while the interpreter ends
        signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


def test_command_inside_another_program_sets_no_sigint_handler() -> None:
    before = signal.getsignal(signal.SIGINT)
    with CommandInterrupts().handling(is_process=False):
        assert signal.getsignal(signal.SIGINT) is before
