"""``topic echo``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.cdr import Message
from rosidl_py_gen.runtime import AdaptiveSubscription, WaitTimeoutError
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools import Job, ToolError, printing, types
from rosidl_py_gen.tools.commands.topic import EchoOptions
from rosidl_py_gen.tools.filters import FilterError, compile_filter, compile_path, path_field
from rosidl_py_gen.tools.messages import array_summary
from rosidl_py_gen.tools.names import find_topic, full_topic_name
from rosidl_py_gen.tools.session import Network, Session, now_s
from rosidl_py_gen.tools.topic import qos as topic_qos
from rosidl_py_gen.tools.topic.formats import Format

_LOST_EVERY_S = 1.0
_EARLY = 0.25
"""Of the period of ``--max-rate``: so much earlier than due a message is printed."""


def run(network: Network, options: EchoOptions) -> Job:
    """What the command does."""
    return Job(_echo(network, options), endless=not options.once)


async def _echo(network: Network, options: EchoOptions) -> int:
    async with Session(network) as session:
        naming = _topic_name(session, options)
        topic = await (naming if options.raw else types.meanwhile(naming))
        await _Echo(session, topic, options).run()
    return 0


async def _topic_name(session: Session, options: EchoOptions) -> str:
    """The full name of the topic, once its publishers had time to be seen."""
    if options.type_name is None:
        return await find_topic(session, options.topic, options.timeout_s)
    topic = full_topic_name(session, options.topic)
    await session.wait_until_quiet()
    return topic


class _Echo:
    def __init__(self, session: Session, topic: str, options: EchoOptions) -> None:
        self._session = session
        self._topic = topic
        self._options = options
        self._pace = _Pace(options.max_rate_hz)
        self._show: Callable[[Any], bool] = lambda value: True
        self._has_received = False
        self._lost_noted = 0
        self._lost_noted_at = 0.0

    async def run(self) -> None:
        """Print until there is enough."""
        options = self._options
        shown = Format(options.style, options.full_length, options.truncate_length, options.arrays, options.strings)
        if options.raw:
            cls = types.opaque_class(self._session, self._topic, options.type_name)
            self._show = _shows(lambda value: value, lambda value: True, self._pace, shown.printer())
        else:
            cls = await types.message_class(self._session, self._topic, options.type_name, options.paths)
            field = _fields(cls, options.fields, options.arrays)
            condition = compile_filter(options.filter_text, cls) if options.filter_text else lambda value: True
            self._show = _shows(field, condition, self._pace, shown.printer())
        given = topic_qos.given(options.qos, presets.SENSOR_DATA)
        following: AdaptiveSubscription[Any] = AdaptiveSubscription(
            self._session.node, self._topic, cls, raw=options.raw, qos=given, note=printing.note
        )
        async with following as messages:
            try:
                await self._print_from(messages)
            finally:
                self._pace.tell()

    async def _print_from(self, messages: AdaptiveSubscription[Any]) -> None:
        timeout_s = self._options.timeout_s
        shown_at = now_s()
        while True:
            left_s = None if timeout_s is None else max(0.0, shown_at + timeout_s - now_s())
            try:
                message, _ = await messages.receive_with_info(left_s)
            except WaitTimeoutError as error:
                raise ToolError(self._silence(error.reason)) from None
            self._has_received = True
            if self._show(message):
                shown_at = now_s()
                if self._options.once:
                    return
            if self._options.lost_messages:
                self._note_lost(messages.dropped)

    def _silence(self, reason: str) -> str:
        text = f"on {self._topic} in {self._options.timeout_s:g} s"
        if self._options.filter_text and self._has_received:
            return f"no message that the filter lets through {text}"
        return f"no message {text}: {reason}"

    def _note_lost(self, total: int) -> None:
        if total > self._lost_noted and (now := now_s()) > self._lost_noted_at + _LOST_EVERY_S:
            printing.note(f"{total - self._lost_noted} messages came faster than they were printed ({total} in all)")
            self._lost_noted, self._lost_noted_at = total, now


def _fields(cls: type[Message], paths: Sequence[str], arrays: bool) -> Callable[[Message], Any]:
    """Return what gives the values to print: the message, the value of one path, or a dict of several."""
    if not paths:
        return lambda message: message

    def one(path: str) -> Callable[[Message], Any]:
        value, field = compile_path(path, cls), None if arrays else path_field(path, cls)
        if field is None or field.type.arity is Arity.SCALAR:
            return value
        return lambda message: array_summary(field, value(message))

    values = {path: one(path) for path in paths}
    if len(values) == 1:
        return values[paths[0]]
    return lambda message: {path: value(message) for path, value in values.items()}


class _Pace:
    """Which messages are printed when at most `max_hz` a second may be: None for all.

    Decides that one may come a little early, at the cost of the next: of a topic that is just as fast, all are printed.
    """

    def __init__(self, max_hz: float | None) -> None:
        self._max_hz = max_hz
        self._period_s = 1 / max_hz if max_hz else 0.0
        self._next_s = 0.0
        self._dropped = 0

    def admits(self) -> bool:
        """Whether one may be printed now; counts those that may not."""
        if self._max_hz is None:
            return True
        now = now_s()
        if now < self._next_s - self._period_s * _EARLY:
            self._dropped += 1
            return False
        self._next_s = max(now, self._next_s) + self._period_s
        return True

    def tell(self) -> None:
        """Say how many were not printed, if any."""
        if self._dropped:
            printing.note(f"{self._dropped} messages were dropped, as --max-rate is {self._max_hz:g}")


def _shows(
    field: Callable[[Any], Any], condition: Callable[[Any], bool], pace: _Pace, show: Callable[[Any], None]
) -> Callable[[Any], bool]:
    """Prints a message that meets the condition, when it is time for one, and says whether it met it.

    What has no value is noted once.
    """
    noted: set[str] = set()

    def shows(message: Any) -> bool:
        try:
            if not condition(message):
                return False
            value = field(message)
        except FilterError as error:
            if str(error) not in noted and len(noted) < 10:
                noted.add(str(error))
                printing.note(f"left out a message: {error}")
            return False
        if pace.admits():
            show(value)
        return True

    return shows
