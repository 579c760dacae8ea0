"""Parts of ``bag play`` and ``bag record``: keys of the terminal, and QoS overrides.

The mode of the terminal is restored at the end, and on every signal that ends or stops this process. No keys are read
if standard input is not a terminal, or if the process is in the background.

The option ``--qos-profile-overrides-path`` names a YAML file with QoS profiles of topics, in the format of rosbag2::

    /scan:
      reliability: best_effort
      history: keep_last
      depth: 5
      deadline: {sec: 0, nsec: 500000000}

Missing policies have the values of ROS's default profile.
"""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
import threading
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.errors import InvalidNameError
from rosidl_py_gen.ros_cli.bag.yaml_files import entries, parse, read_text, text, wrong
from rosidl_py_gen.runtime import InvalidQoSError, QoSProfile, qos, validate_full_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from rosidl_py_gen.ros_cli.bag.yaml_files import YamlNode, YamlScalar

_ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
_KEY = re.compile(rb"\x1b[\[O]([A-D])|( )")
_INCOMPLETE_KEY = re.compile(rb"\x1b[\[O]?\Z")
_GIVING_UP = "SIGHUP", "SIGQUIT", "SIGTSTP"
"""Signals that end or stop this process without running its clean-up code, unlike SIGINT and SIGTERM."""


def keys_of(data: bytes) -> tuple[list[str], bytes]:
    """Return the names of keys in bytes from a terminal, such as ``up``, and the bytes of an incomplete key."""
    keys = [_ARROWS[one[1]] if one[1] else "space" for one in _KEY.finditer(data)]
    incomplete = _INCOMPLETE_KEY.search(data)
    return keys, incomplete[0] if incomplete else b""


@contextmanager
def read_keys(actions: Mapping[str, Callable[[], object]]) -> Iterator[bool]:
    """Call the action of each pressed key on the running loop while the block runs.

    Yields True, or False if no keys can be read.
    """
    try:
        import termios

        stream = sys.stdin.fileno()
        terminal = _Terminal(stream, termios) if _is_foreground(stream) else None
    except (ImportError, OSError, ValueError):  # Windows; no terminal; closed
        terminal = None
    if terminal is None:
        yield False
        return
    loop = asyncio.get_running_loop()
    rest = b""

    def read() -> None:
        nonlocal rest
        if not _is_foreground(stream):
            return
        data = b""
        with suppress(OSError):
            data = os.read(stream, 1024)
        if not data:  # the terminal was closed
            loop.remove_reader(stream)
        names, rest = keys_of(rest + data)
        for name in names:
            if name in actions:
                actions[name]()

    with terminal:
        loop.add_reader(stream, read)
        try:
            yield True
        finally:
            loop.remove_reader(stream)


def _is_foreground(stream: int) -> bool:
    """Return True if this process may access its terminal; the kernel would stop a background process."""
    try:
        return os.isatty(stream) and os.tcgetpgrp(stream) == os.getpgrp()
    except OSError:
        return False


class _Terminal:
    """Terminal in raw mode: keys are reported when they are pressed, and not printed."""

    def __init__(self, stream: int, termios: Any) -> None:
        self._stream = stream
        self._termios = termios
        self._original_mode = termios.tcgetattr(stream)
        self._handlers: dict[int, Any] = {}

    def __enter__(self) -> None:
        if threading.current_thread() is threading.main_thread():
            handlers = {
                **dict.fromkeys(_GIVING_UP, self._give_up),
                "SIGCONT": lambda number, frame: self._set_raw_mode(),
            }
            for name, handler in handlers.items():
                number = getattr(signal, name)
                self._handlers[number] = signal.signal(number, handler)
        self._set_raw_mode()

    def __exit__(self, *_: object) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)
        self._restore_mode()

    def _set_raw_mode(self) -> None:
        import tty

        if _is_foreground(self._stream):
            with suppress(self._termios.error):
                tty.setcbreak(self._stream, self._termios.TCSADRAIN)

    def _restore_mode(self) -> None:
        if _is_foreground(self._stream):
            with suppress(self._termios.error):
                self._termios.tcsetattr(self._stream, self._termios.TCSADRAIN, self._original_mode)

    def _give_up(self, number: int, _: object) -> None:
        self._restore_mode()
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)  # of SIGTSTP, returns after SIGCONT
        signal.signal(number, self._give_up)


_PERIOD_FIELDS = {policy.rmw_name: policy.field for policy in qos.POLICIES if policy.is_period}
_CHOICES: dict[str, dict[str, Any]] = {
    **{
        policy.rmw_name: {one.name.lower(): one for one in policy.enum if one.name != "UNKNOWN"}
        for policy in qos.POLICIES
        if policy.enum is not None
    },
    **{policy.rmw_name: {"true": True, "false": False} for policy in qos.POLICIES if policy.is_flag},
}
_LIMITS = {policy.rmw_name: policy.limits for policy in qos.POLICIES if policy.limits is not None}
_KEYS = tuple(policy.rmw_name for policy in qos.POLICIES)
_EXPECTED = f"expected policies, of {', '.join(_KEYS)}"


def read_qos_overrides(path: str | None) -> dict[str, QoSProfile]:
    """Read a file of QoS profiles by topic; {} without a file.

    Raises `CommandError` or OSError if it is invalid or missing.
    """
    return {} if path is None else parse_qos_overrides(read_text(path, "profiles"), path)


def parse_qos_overrides(source: str, name: str = "<profiles>") -> dict[str, QoSProfile]:
    """Parse a text with QoS profiles by full topic name; raises `CommandError` with `name` and line if invalid."""
    profiles = {}
    for topic, policies in entries(parse(source, name), name, "expected topics, and the policies of each below it"):
        try:
            validate_full_name(topic.value)
        except InvalidNameError as error:
            wrong(topic, name, f"expected the full name of a topic: {error}")
        values = dict(_policy(key, value, name) for key, value in entries(policies, name, _EXPECTED))
        try:
            profiles[topic.value] = QoSProfile(**values)
        except InvalidQoSError as error:
            wrong(policies, name, f"{topic.value}: {error}")
    return profiles


def _policy(key: YamlScalar, value: YamlNode, name: str) -> tuple[str, Any]:
    policy: str = key.value
    if choices := _CHOICES.get(policy):
        expected = f"{policy}: expected one of {', '.join(choices)}"
        word = text(value, name, expected).lower()
        if word not in choices:
            wrong(value, name, f'{expected}; found "{word[:80]}"{did_you_mean(word, choices)}')
        return policy, choices[word]
    if policy in _PERIOD_FIELDS:
        return _PERIOD_FIELDS[policy], _period(policy, value, name)
    if policy in _LIMITS:
        return policy, _number(value, name, policy, is_signed=_LIMITS[policy][0] < 0)
    wrong(key, name, f'{_EXPECTED}; found "{policy[:80]}"{did_you_mean(policy, _KEYS)}')


def _period(policy: str, node: YamlNode, name: str) -> int:
    expected = f"{policy}: expected sec: and nsec:"
    values = {}
    for key, value in entries(node, name, expected):
        if key.value not in ("sec", "nsec"):
            wrong(key, name, f'{expected}, found "{key.value[:80]}"')
        values[key.value] = _number(value, name, f"{policy}: {key.value}")
    if len(values) == 1:
        wrong(node, name, f"{expected}, found only {next(iter(values))}:")
    return min(values.get("sec", 0) * NS_PER_S + values.get("nsec", 0), qos.INFINITE_NS)


def _number(node: YamlNode, name: str, policy: str, *, is_signed: bool = False) -> int:
    expected = f"{policy}: expected a whole number{'' if is_signed else ', 0 or more'}"
    word = text(node, name, expected)
    digits = word.removeprefix("-") if is_signed else word
    if not (digits.isascii() and digits.isdecimal() and len(digits) < 20):
        wrong(node, name, f'{expected}; found "{word[:80]}"')
    return int(word)
