"""Command ``rosidl-py log``: prints log messages, live, retained by /rosout, or recorded.

Retained messages arrive node by node and are printed in the order of their stamps.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import click

from rosidl_py_gen.base.stamps import sec_nanosec, stamp_ns
from rosidl_py_gen.base.terminal_text import printable_line
from rosidl_py_gen.command_support import terminal_output
from rosidl_py_gen.ros_cli import AsyncCommand, options, verb

if TYPE_CHECKING:
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import AdaptiveSubscription, QoSProfile

_TOPIC = "/rosout"
_TYPE = "rcl_interfaces/msg/Log"
_DEPTH = 1000
_RETAINED_S = 0.3
"""Time in seconds in which retained messages are collected before the first one is printed."""
_LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
_NAMES = {number: name.upper() for name, number in _LEVELS.items()}
_STYLES = {10: "green", 30: "yellow", 40: "red", 50: "bold red"}


@click.command("log")
@click.option(
    "-l", "--level", type=click.Choice([*_LEVELS], case_sensitive=False), default="debug", help="Minimum level."
)
@click.option(
    "--node",
    "nodes",
    multiple=True,
    metavar="NAME",
    shell_complete=options.completion("nodes"),
    help="Only loggers of a node, /ns/name or ns.name; * matches any text. May be repeated.",
)
@click.option("-t", "--text", "pattern", metavar="REGEX", help="Only messages in which REGEX matches.")
@click.option("-n", "--times", type=click.IntRange(1), metavar="N", help="Stop after N messages.")
@click.option("--new", "only_new", is_flag=True, help="Skip the messages of the last ten seconds, which nodes retain.")
@click.option("-v", "--verbose", is_flag=True, help="Show also file, line and function.")
@click.option("--bag", metavar="PATH", type=click.Path(), help="Print the messages of a recording and end.")
@options.as_json
@options.node_options
@verb
def log(
    network: options.NetworkOptions,
    level: str,
    nodes: Sequence[str],
    pattern: str | None,
    times: int | None,
    only_new: bool,
    verbose: bool,
    as_json: bool,
    bag: str | None,
) -> AsyncCommand | None:
    """Print the log messages of all nodes, from /rosout.

    \b
    rosidl-py log
    rosidl-py log --level warn --node '/camera*'
    rosidl-py log --bag drive.mcap --text 'lost|late'
    """
    if bag is not None and only_new:
        raise click.UsageError("--new has no meaning for a recording; use either --bag or --new")
    printer = LogPrinter(level, nodes, pattern, times=times, verbose=verbose, as_json=as_json)
    if bag is None:
        return AsyncCommand(_follow(network, printer, only_new), endless=times is None)
    _print_recorded(bag, printer)
    return None


def _print_recorded(path: str, printer: LogPrinter) -> None:
    from rosidl_py_gen.ros_cli.bag.reading import messages_of_type

    for one in messages_of_type(path, _TYPE):
        if printer.is_done:
            break
        printer.show(one.message)


async def _follow(network: options.NetworkOptions, printer: LogPrinter, only_new: bool) -> None:
    from rosidl_py_gen import get_message
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import AdaptiveSubscription

    async with CommandNode(network) as command_node:
        await command_node.wait_for_discovery()
        cls: Any = get_message(_TYPE)
        qos = _profile(command_node, only_new)
        subscription: AdaptiveSubscription[Any] = AdaptiveSubscription(
            command_node.node, _TOPIC, cls, qos=qos, depth=_DEPTH, note=terminal_output.note
        )
        async with subscription as messages:
            for message in await _retained(messages):
                printer.show(message)
            while not printer.is_done:
                message, _ = await messages.receive_with_info()
                printer.show(message)


def _profile(command_node: CommandNode, only_new: bool) -> QoSProfile | None:
    """Return the QoS for a subscription to /rosout.

    Returns None, which adapts to publishers, if a node offers less than usual.
    """
    from rosidl_py_gen.runtime import Durability, QoSProfile, Reliability

    if only_new:
        return QoSProfile(depth=_DEPTH)
    for one in command_node.node.get_publishers_info_by_topic(_TOPIC):
        offered = one.qos_profile
        if (offered.reliability, offered.durability) != (Reliability.RELIABLE, Durability.TRANSIENT_LOCAL):
            return None
    return QoSProfile(depth=_DEPTH).transient_local()


async def _retained(messages: AdaptiveSubscription[Any]) -> list[Any]:
    from rosidl_py_gen.command_support import CommandNode
    from rosidl_py_gen.runtime import WaitTimeoutError

    received = []
    end_s = CommandNode.now_s() + _RETAINED_S
    try:
        while (left_s := end_s - CommandNode.now_s()) > 0:
            received.append((await messages.receive_with_info(left_s))[0])
    except WaitTimeoutError:
        pass
    return sorted(received, key=lambda message: stamp_ns(message.stamp))


class LogPrinter:
    """Printer of messages of ``rcl_interfaces/msg/Log``, which are filtered.

    Args:
        level: name of the minimum level.
        nodes: patterns for names of nodes; empty means all.
        pattern: regular expression for texts.
        times: number of messages after which `is_done` is True; None means no limit.
    """

    def __init__(
        self, level: str, nodes: Sequence[str], pattern: str | None, *, times: int | None, verbose: bool, as_json: bool
    ) -> None:
        self._level = _LEVELS[level.lower()]
        # Names of loggers have dots in place of slashes, and a node may have child loggers.
        self._names = [one.strip("/").replace("/", ".") for one in nodes]
        self._pattern = options.compile_pattern(pattern, "--text") if pattern else None
        self._left, self._verbose, self._as_json = times, verbose, as_json

    @property
    def is_done(self) -> bool:
        """True once the requested number of messages has been printed."""
        return self._left == 0

    def show(self, message: Any) -> None:
        """Print a log message if it passes the filters and the limit is not reached."""
        if self.is_done or not self._is_selected(message):
            return
        if self._left is not None:
            self._left -= 1
        if self._as_json:
            terminal_output.document(_row(message), in_stream=True)
            return
        seconds, rest = sec_nanosec(stamp_ns(message.stamp))
        head = printable_line(f"[{_level_name(message.level)}] [{seconds}.{rest:09}] [{message.name}]: ")
        rows = [head + message.msg]
        if self._verbose and message.file:
            rows.append(printable_line(f"at {message.file}:{message.line} in {message.function}"))
        terminal_output.block("\n".join(rows).replace("\n", "\n    "), _STYLES.get(message.level // 10 * 10, ""))

    def _is_selected(self, message: Any) -> bool:
        return (
            message.level >= self._level
            and (not self._names or any(_matches(message.name, pattern) for pattern in self._names))
            and (self._pattern is None or self._pattern.search(message.msg) is not None)
        )


def _matches(logger: str, pattern: str) -> bool:
    return fnmatchcase(logger, pattern) or fnmatchcase(logger, f"{pattern}.*")


def _level_name(level: int) -> str:
    return _NAMES.get(level, str(level))


def _row(message: Any) -> dict[str, Any]:
    return {
        "time_ns": stamp_ns(message.stamp),
        "level": _level_name(message.level),
        "name": message.name,
        "text": message.msg,
        "file": message.file,
        "line": message.line,
        "function": message.function,
    }
