"""``topic pub``.

Decides when messages go out: one text is published again and again, each of the documents of standard input once.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Sequence
from contextlib import aclosing, suppress
from dataclasses import replace
from typing import Any

from rosidl_py_gen.cdr import Message
from rosidl_py_gen.runtime import Publisher, WaitTimeoutError
from rosidl_py_gen.runtime import qos as presets
from rosidl_py_gen.tools import Job, ToolError, messages, printing, types
from rosidl_py_gen.tools.commands.topic import PubOptions
from rosidl_py_gen.tools.names import find_topic, full_topic_name
from rosidl_py_gen.tools.session import Network, Session
from rosidl_py_gen.tools.topic import qos as topic_qos
from rosidl_py_gen.tools.topic.stdin import documents

_ACKNOWLEDGED_S = 5.0
_NOTE_EVERY_S = 1.0
_STDIN = "-"


def run(network: Network, options: PubOptions) -> Job:
    """What the command does."""
    type_name, text = messages.type_and_values(options.words)
    if options.once:
        options = replace(options, times=1)
    return Job(_publish(network, type_name, text, options), endless=options.times is None and text != _STDIN)


async def _publish(network: Network, type_name: str | None, text: str, options: PubOptions) -> int:
    async with Session(network) as session:
        if type_name is None:
            topic = await types.meanwhile(find_topic(session, options.topic, options.timeout_s))
        else:
            topic = full_topic_name(session, options.topic)
        cls = await types.message_class(session, topic, type_name, options.paths)
        ready = None if text == _STDIN else messages.message_and_stamps(cls, text)  # before anybody is waited for
        qos = topic_qos.given(options.qos, presets.DEFAULT) or presets.DEFAULT
        publisher: Publisher[Any] = session.node.create_publisher(cls, topic, qos)
        ends = options.times is not None or ready is None
        await _subscribed(publisher, int(ends) if options.wait is None else options.wait, options.timeout_s)
        if not options.as_json:
            printing.line("publisher: beginning loop")
        made = _again_and_again(*ready) if ready else _from_stdin(cls)
        async with aclosing(made) as several:
            await _publish_each(session, publisher, several, options, paced=ready is not None)
        began = asyncio.get_running_loop().time()
        with suppress(WaitTimeoutError):
            await publisher.wait_for_acknowledged(_ACKNOWLEDGED_S)
        await asyncio.sleep(began + options.keep_alive_s - asyncio.get_running_loop().time())
    return 0


async def _subscribed(publisher: Publisher[Any], count: int, limit_s: float | None) -> None:
    """Wait for so many subscriptions, and say so."""
    loop = asyncio.get_running_loop()
    began = loop.time()
    patience_s = 0.1  # most are there at once, and need no note
    while True:
        try:
            await publisher.wait_for_subscribers(patience_s, count=count)
            return
        except WaitTimeoutError as error:
            reason = f": {error.reason}" if error.reason else ""
        waited_s = loop.time() - began
        if limit_s is not None and waited_s >= limit_s:
            there = publisher.subscription_count
            found = f"{there} subscriptions on {publisher.topic} in {limit_s:g} s, expected at least {count}"
            raise ToolError(found + reason)
        printing.note(f"Waiting for at least {count} matching subscription(s) on {publisher.topic}...")
        patience_s = _NOTE_EVERY_S if limit_s is None else min(_NOTE_EVERY_S, limit_s - waited_s)


async def _publish_each(
    session: Session, publisher: Publisher[Any], several: AsyncIterator[Message], options: PubOptions, *, paced: bool
) -> None:
    hz = options.rate or (1.0 if paced else None)
    rate = None if hz is None else session.node.create_rate(hz)
    number = 0
    async for message in several:
        number += 1
        if options.print_every and number % options.print_every == 0:
            _show(number, message, options.as_json)
        publisher.publish(message)
        if number == options.times:
            return
        if rate is not None:
            await rate.sleep()


def _show(number: int, message: Message, as_json: bool) -> None:
    if as_json:
        printing.document({"number": number, "message": messages.plain(message, truncate=None)}, in_stream=True)
    else:
        printing.lines([f"publishing #{number}: {messages.shown(message, messages.TRUNCATE)}", ""])


async def _again_and_again(message: Message, stamps: Sequence[Any]) -> AsyncGenerator[Message, None]:
    while True:
        messages.set_stamps(stamps)
        yield message


async def _from_stdin(cls: type[Message]) -> AsyncGenerator[Message, None]:
    number = 0
    async with aclosing(documents()) as texts:
        async for text in texts:
            number += 1
            try:
                yield messages.message_from(cls, text)
            except ToolError as error:
                raise ToolError(f"document {number} of standard input: {error}") from None
