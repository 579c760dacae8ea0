"""Command ``topic pub``: publishes one message repeatedly, or each document of standard input once."""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing, suppress
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.command_support import CommandError, terminal_output
from rosidl_py_gen.ros_cli import options
from rosidl_py_gen.ros_cli.topic import qos_options, requested_profile

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import Publisher

_ACKNOWLEDGE_TIMEOUT_S = 5.0
"""Maximum time to wait at the end until subscribers have acknowledged all messages, in seconds."""
_WAITING_NOTE_INTERVAL_S = 1.0
_STDIN = "-"


@click.command("pub")
@options.topic_argument()
@click.argument("words", metavar="[TYPE] [VALUES]", nargs=-1, shell_complete=options.call_completion("topic"))
@options.rate("-r", "--rate", help="Messages per second.  [default: 1]")
@click.option("-1", "--once", is_flag=True, help="Publish one message and end.")
@click.option("-t", "--times", type=click.IntRange(1), metavar="N", help="Publish N messages and end.")
@click.option(
    "-w",
    "--wait-matching-subscriptions",
    "wait",
    type=click.IntRange(0),
    metavar="N",
    help="Number of subscriptions to wait for.  [default: 1 with --once, --times or -, else 0]",
)
@options.seconds(
    *("--timeout", "--max-wait-time-secs", "timeout_s"),
    help="Maximum time to wait for the topic, and for subscriptions.  [default: 5, and no limit]",
)
@click.option(
    "-p",
    "--print",
    "print_every",
    type=click.IntRange(0),
    default=1,
    metavar="N",
    help="Print every N-th message; 0 prints none.",
)
@options.seconds("--keep-alive", "keep_alive_s", default=0.1, help="Time to stay after the last message.")
@qos_options
@options.paths
@options.as_json
@options.endless_node_verb(lambda given: not (given["once"] or given["times"] or given["words"][-1:] == (_STDIN,)))
async def pub(
    command_node: CommandNode,
    topic: str,
    words: tuple[str, ...],
    rate: float | None,
    once: bool,
    times: int | None,
    wait: int | None,
    timeout_s: float | None,
    print_every: int,
    keep_alive_s: float,
    qos: dict[str, Any],
    paths: tuple[str, ...],
    as_json: bool,
) -> None:
    """Publish messages.

    \b
    rosidl-py topic pub /chatter std_msgs/msg/String 'data: hello' --rate 10
    rosidl-py topic pub --once /goal geometry_msgs/msg/PoseStamped '{header: auto, pose: {position: {x: 1}}}'
    rosidl-py topic echo --json /a | rosidl-py topic pub /b -

    VALUES is YAML or JSON; omitted fields have their defaults. "header: auto" and "stamp: now" are set for each
    message. With - each document of standard input is published once. TYPE may be omitted for an existing topic.
    """
    import asyncio

    from rosidl_py_gen.command_support import interface_class, preload_while_waiting
    from rosidl_py_gen.ros_cli import message_text
    from rosidl_py_gen.runtime import WaitTimeoutError
    from rosidl_py_gen.runtime import qos as presets

    type_name, text = message_text.type_and_values(words)
    max_count = 1 if once else times
    if type_name is None:
        name = await preload_while_waiting(command_node.find("topic", topic, timeout_s))
    else:
        name = command_node.full_name(topic)
    cls = await interface_class(command_node, "topic", name, type_name, paths)
    # Before the wait for subscriptions, so that errors in the text are reported at once.
    template = None if text == _STDIN else message_text.message_and_stamps(cls, text)
    profile = requested_profile(qos, presets.DEFAULT) or presets.DEFAULT
    publisher: Publisher[Any] = command_node.node.create_publisher(cls, name, profile)
    ends = max_count is not None or template is None
    await _wait_for_subscriptions(publisher, int(ends) if wait is None else wait, timeout_s)
    if not as_json:
        terminal_output.line("publisher: beginning loop")
    hz = rate or (1.0 if template else None)
    pace = None if hz is None else command_node.node.create_rate(hz)
    async with aclosing(_repeated(*template) if template else _from_stdin(cls)) as messages:
        number = 0
        async for message in messages:
            number += 1
            if print_every and number % print_every == 0:
                _show(number, message, as_json)
            publisher.publish(message)
            if number == max_count:
                break
            if pace is not None:
                await pace.sleep()
    published_s = command_node.now_s()
    with suppress(WaitTimeoutError):
        await publisher.wait_for_acknowledged(_ACKNOWLEDGE_TIMEOUT_S)
    await asyncio.sleep(published_s + keep_alive_s - command_node.now_s())


async def _wait_for_subscriptions(publisher: Publisher[Any], count: int, limit_s: float | None) -> None:
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import WaitTimeoutError

    start_s = CommandNode.now_s()
    wait_s = 0.1  # most subscriptions are found at once, without a note
    while True:
        try:
            await publisher.wait_for_subscribers(wait_s, count=count)
            return
        except WaitTimeoutError as error:
            reason = f": {error.reason}" if error.reason else ""
        waited_s = CommandNode.now_s() - start_s
        if limit_s is not None and waited_s >= limit_s:
            text = f"{pluralize(publisher.subscription_count, 'subscription')} on {publisher.topic} in {limit_s:g} s"
            raise CommandError(f"{text}, expected at least {count}{reason}")
        terminal_output.note(
            f"Waiting for at least {pluralize(count, 'matching subscription')} on {publisher.topic}..."
        )
        wait_s = _WAITING_NOTE_INTERVAL_S if limit_s is None else min(_WAITING_NOTE_INTERVAL_S, limit_s - waited_s)


def _show(number: int, message: Message, as_json: bool) -> None:
    from rosidl_py_gen.ros_cli import message_text

    if as_json:
        terminal_output.document(
            {"number": number, "message": message_text.to_plain(message, truncate=None)}, in_stream=True
        )
    else:
        terminal_output.lines([f"publishing #{number}: {message_text.rclpy_repr(message, message_text.TRUNCATE)}", ""])


async def _repeated(message: Message, stamps: Sequence[Any]) -> AsyncGenerator[Message, None]:
    from rosidl_py_gen.ros_cli import message_text

    while True:
        message_text.set_stamps(stamps)
        yield message


async def _from_stdin(cls: type[Message]) -> AsyncGenerator[Message, None]:
    from rosidl_py_gen.ros_cli import message_text
    from rosidl_py_gen.ros_cli.values import documents

    number = 0
    async with aclosing(documents()) as texts:
        async for text in texts:
            number += 1
            try:
                yield message_text.message_from(cls, text)
            except CommandError as error:
                raise CommandError(f"document {number} of standard input: {error}") from None
