"""``topic echo``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from rosidl_py_gen.runtime import WaitTimeoutError
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools import Job, ToolError, printing, types
from rosidl_py_gen.tools.filters import FilterError, compile_filter, compile_path
from rosidl_py_gen.tools.follow import Follow
from rosidl_py_gen.tools.names import find_topic, full_topic_name
from rosidl_py_gen.tools.session import Network, Session, now_s
from rosidl_py_gen.tools.topic import qos as topic_qos
from rosidl_py_gen.tools.topic.formats import Format, Style

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
        return await find_topic(session, wanted.topic, wanted.timeout_s)
    topic = full_topic_name(session, wanted.topic)
    await session.settle()
    return topic


class _Echo:
    def __init__(self, session: Session, topic: str, wanted: _Wanted) -> None:
        self._session = session
        self._topic = topic
        self._wanted = wanted
        self._show: Callable[[Any], bool] = lambda value: True
        self._lost_noted = 0
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
        given = topic_qos.given(wanted.qos, presets.SENSOR_DATA)
        async with Follow(
            self._session.node, self._topic, cls, raw=wanted.raw, qos=given, note=printing.note
        ) as messages:
            await self._print_from(messages)

    async def _print_from(self, messages: Follow) -> None:
        timeout_s = self._wanted.timeout_s
        shown_at = now_s()
        while True:
            left_s = None if timeout_s is None else max(0.0, shown_at + timeout_s - now_s())
            try:
                message, _ = await messages.receive_with_info(left_s)
            except WaitTimeoutError:
                raise ToolError(self._silence()) from None
            if self._show(message):
                shown_at = now_s()
                if self._wanted.once:
                    return
            if self._wanted.lost_messages:
                self._note_lost(messages.dropped)

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
