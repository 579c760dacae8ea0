"""Handlers of SIGINT and SIGTERM: they shut contexts down and call the previous handler.

Python installs handlers in the main thread only; `rclpy.init` in another thread installs none.
"""

from __future__ import annotations

import signal
import threading
from typing import TYPE_CHECKING, Any

from rclpy._rclpy_pybind11 import ScopedEnumOfC
from rclpy.context import mark_all_shut_down
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition

if TYPE_CHECKING:
    from types import FrameType

    from rclpy.context import Context


class SignalHandlerOptions(ScopedEnumOfC):
    """Selection of the signals (SIGINT, SIGTERM) that shut contexts down."""

    NO = 0
    SIGINT = 1
    SIGTERM = 2
    ALL = 3


_SIGNALS = {SignalHandlerOptions.SIGINT: signal.SIGINT, SignalHandlerOptions.SIGTERM: signal.SIGTERM}
_previous_handlers: dict[int, Any] = {}
_sigint_guards: list[GuardCondition] = []


def _on_signal(number: int, frame: FrameType | None) -> None:
    mark_all_shut_down()
    if number == signal.SIGINT:
        for guard in list(_sigint_guards):
            if guard.handle.is_valid:
                guard.handle.trigger_guard_condition()
    previous = _previous_handlers.get(number)
    if callable(previous):
        previous(number, frame)


def install_signal_handlers(options: SignalHandlerOptions = SignalHandlerOptions.ALL) -> None:
    """Install handlers that make the selected signals, and no others, shut contexts down."""
    options = SignalHandlerOptions(options)
    if threading.current_thread() is not threading.main_thread():
        return
    for option, number in _SIGNALS.items():
        if options.value & option.value:
            _install_handler(number)
        else:
            _uninstall_handler(number)


def _install_handler(number: int) -> None:
    current = signal.getsignal(number)
    if current is not _on_signal:
        _previous_handlers[number] = current
        signal.signal(number, _on_signal)


def _uninstall_handler(number: int) -> None:
    previous = _previous_handlers.pop(number, None)
    if signal.getsignal(number) is _on_signal:
        signal.signal(number, signal.SIG_DFL if previous is None else previous)


def get_current_signal_handlers_options() -> SignalHandlerOptions:
    """Return the signals that shut contexts down at present."""
    return SignalHandlerOptions(
        sum(option.value for option, number in _SIGNALS.items() if number in _previous_handlers)
    )


def uninstall_signal_handlers() -> None:
    """Restore the signal handlers from before `install_signal_handlers`."""
    install_signal_handlers(SignalHandlerOptions.NO)


class SignalHandlerGuardCondition(GuardCondition):
    """Guard condition that SIGINT triggers while rclpy's handler is installed."""

    def __init__(self, context: Context | None = None) -> None:
        super().__init__(callback=None, callback_group=None, context=context)
        _sigint_guards.append(self)

    def destroy(self) -> None:
        """Destroy the guard condition; the second call raises InvalidHandle."""
        super().destroy()
        _sigint_guards.remove(self)
