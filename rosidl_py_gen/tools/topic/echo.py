"""``topic echo``.

Decides how a subscription follows its publishers: when one appears that offers less than was asked for, it is made
again, so that every publisher is heard.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import Subscription, WaitTimeoutError
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools import Job, ToolError, printing, types
from rosidl_py_gen.tools.filters import FilterError, compile_filter, compile_path
from rosidl_py_gen.tools.session import Network, Session, now_s
from rosidl_py_gen.tools.topic import qos as topic_qos
from rosidl_py_gen.tools.topic.formats import Format, Style
from rosidl_py_gen.tools.topic.wait import found, full_name

_LOST_EVERY_S = 1.0


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What the command line says, in the end."""

    topic: str
    type_name: str | None
    paths: Sequence[str]
    qos: dict[str, Any]
    timeout_s: float | None
    once: bool
    raw: bool
    lost_messages: bool
    field: str | None
    filter_text: str | None
    format: Format


def run(
    network: Network,
    *,
    style: Style,
    full_length: bool,
    truncate_length: int | None,
    arrays: bool,
    strings: bool,
    **wanted: Any,
) -> Job:
    """What the command does."""
    shown = Format(style, full_length, truncate_length, arrays, strings)
    return Job(_echo(network, _Wanted(format=shown, **wanted)), endless=not wanted["once"])


async def _echo(network: Network, wanted: _Wanted) -> int:
    async with Session(network) as session:
        naming = _topic_name(session, wanted)
        topic = await (naming if wanted.raw else types.meanwhile(naming))
        await _Echo(session, topic, wanted).run()
    return 0


async def _topic_name(session: Session, wanted: _Wanted) -> str:
    """The full name of the topic, once its publishers had time to be seen."""
    if wanted.type_name is None:
        return await found(session, wanted.topic, wanted.timeout_s)
    topic = full_name(session, wanted.topic)
    await session.settle()
    return topic


class _Echo:
    def __init__(self, session: Session, topic: str, wanted: _Wanted) -> None:
        self._session = session
        self._topic = topic
        self._wanted = wanted
        self._show: Callable[[Any], bool] = lambda value: True
        self._shown_at = now_s()
        self._lost = self._lost_noted = 0
        self._lost_noted_at = 0.0

    async def run(self) -> None:
        """Print until there is enough."""
        wanted = self._wanted
        if wanted.raw:
            cls = types.opaque_class(self._session, self._topic, wanted.type_name)
            self._show = _shows(lambda value: value, lambda value: True, wanted.format.printer())
        else:
            cls = await types.message_class(self._session, self._topic, wanted.type_name, wanted.paths)
            field = compile_path(wanted.field, cls) if wanted.field else lambda value: value
            condition = compile_filter(wanted.filter_text, cls) if wanted.filter_text else lambda value: True
            self._show = _shows(field, condition, wanted.format.printer())
        self._shown_at = now_s()
        node = self._session.node
        given = topic_qos.given(wanted.qos, presets.SENSOR_DATA)
        while True:
            profile, notes = topic_qos.chosen(node.get_publishers_info_by_topic(self._topic))
            if given is None:
                for note in notes:
                    printing.note(note)
            raw: Any = wanted.raw
            subscription: Subscription[Any] = node.create_subscription(cls, self._topic, qos=given or profile, raw=raw)
            watching = asyncio.ensure_future(self._close_when_too_much(subscription)) if given is None else None
            try:
                if await self._print_from(subscription):
                    return
            finally:
                subscription.close()
                if watching is not None:
                    watching.cancel()

    async def _close_when_too_much(self, subscription: Subscription[Any]) -> None:
        node = self._session.node
        async for _ in node.graph_changes():
            if topic_qos.is_too_much(subscription.qos, node.get_publishers_info_by_topic(self._topic)):
                subscription.close()
                return

    async def _print_from(self, subscription: Subscription[Any]) -> bool:
        """False when the subscription has to be made again."""
        timeout_s = self._wanted.timeout_s
        while True:
            left_s = None if timeout_s is None else max(0.0, self._shown_at + timeout_s - now_s())
            try:
                message = await subscription.receive(left_s)
            except WaitTimeoutError:
                raise ToolError(self._silence()) from None
            except ClosedError:
                if self._session.node.is_closed:
                    raise
                self._lost += subscription.dropped
                return False
            if self._show(message):
                self._shown_at = now_s()
                if self._wanted.once:
                    return True
            if self._wanted.lost_messages:
                self._note_lost(self._lost + subscription.dropped)

    def _silence(self) -> str:
        publishers = self._session.node.count_publishers(self._topic)
        which = " that the filter lets through" if self._wanted.filter_text else ""
        return f"no message{which} on {self._topic} in {self._wanted.timeout_s:g} s; it has {publishers} publishers"

    def _note_lost(self, total: int) -> None:
        if total > self._lost_noted and (now := now_s()) > self._lost_noted_at + _LOST_EVERY_S:
            printing.note(f"{total - self._lost_noted} messages came faster than they were printed ({total} in all)")
            self._lost_noted, self._lost_noted_at = total, now


def _shows(
    field: Callable[[Any], Any], condition: Callable[[Any], bool], show: Callable[[Any], None]
) -> Callable[[Any], bool]:
    """Prints a message that meets the condition, and says whether it did; what has no value is noted once."""
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
        show(value)
        return True

    return shows
