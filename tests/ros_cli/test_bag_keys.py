"""Keys while ``bag play`` and ``bag record`` run on a terminal, which is restored whatever ends them."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import sys
import termios
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.bag_samples import count_of
from support.node_fixtures import GENERATED, start_process, until

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagWriter
from rosidl_py_gen.ros_cli.keyboard import keys_of, read_keys
from rosidl_py_gen.runtime import QoSProfile

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from support.node_fixtures import World

S = 1_000_000_000
String: Any = get_message("std_msgs/msg/String")
RIGHT, UP, DOWN, SPACE = b"\x1b[C", b"\x1bOA", b"\x1b[B", b" "
HIDE_CURSOR = "\x1b[?25l"
TERMINAL = "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0); "
RUN = f"{TERMINAL}os.execv(sys.executable, [sys.executable, '-m', 'rosidl_py_gen.ros_cli', *sys.argv[1:]])"


@pytest.mark.parametrize(
    ("data", "keys", "rest"),
    [
        (b" ", ["space"], b""),
        (b"\x1b[C\x1bOC", ["right", "right"], b""),
        (b"x\x1b[A\x1b[B\x1b[D y", ["up", "down", "left", "space"], b""),
        (b"\x1b", [], b"\x1b"),
        (b" \x1b[", ["space"], b"\x1b["),
        (b"\x1b[1;5C\xff\x00", [], b""),
    ],
)
def test_keys_are_what_terminals_send(data: bytes, keys: list[str], rest: bytes) -> None:
    assert keys_of(data) == (keys, rest)


@given(st.lists(st.sampled_from([RIGHT, UP, DOWN, SPACE, b"q"])), st.integers(0, 40))
def test_keys_may_come_in_pieces(sent: list[bytes], cut: int) -> None:
    whole = b"".join(sent)
    first, rest = keys_of(whole[:cut])
    second, left = keys_of(rest + whole[cut:])
    assert (first + second, left) == keys_of(whole)


class Terminal:
    """A terminal that a command is in the foreground of, and what was seen on it."""

    def __init__(self) -> None:
        self._ours, self._theirs = os.openpty()
        self.before = self.state()
        self.seen = ""
        self.process: asyncio.subprocess.Process | None = None

    def state(self) -> list[Any]:
        return termios.tcgetattr(self._theirs)

    @property
    def gives_keys(self) -> bool:
        return not self.state()[3] & (termios.ICANON | termios.ECHO)

    async def start(self, *arguments: str) -> None:
        asyncio.get_running_loop().add_reader(self._ours, self._read)
        environment = {**os.environ, "PYTHONPATH": GENERATED.name, "TERM": "xterm", "NO_COLOR": ""}
        stream: Any = self._theirs
        self.process = await start_process(
            *(sys.executable, "-c", RUN, *arguments), stdin=stream, stdout=stream, stderr=stream, env=environment
        )
        await until(lambda: self.gives_keys, 25)

    def _read(self) -> None:
        with suppress(OSError):
            self.seen += os.read(self._ours, 1 << 16).decode(errors="replace")

    @property
    def last(self) -> str:
        return ["", *re.findall(r"\d s of [^;]*;", self.seen)][-1]

    def press(self, keys: bytes) -> None:
        os.write(self._ours, keys)

    async def ended(self) -> int:
        assert self.process is not None
        return await asyncio.wait_for(self.process.wait(), 25)

    def close(self) -> None:
        if self.process is not None and self.process.returncode is None:
            self.process.kill()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    made = Terminal()
    yield made
    made.close()


@pytest.fixture
def bag(tmp_path: Path) -> str:
    """Three strings within a thousand seconds."""
    with BagWriter(tmp_path / "bag") as writer:
        for number in range(3):
            writer.write("/words", String(data=f"w{number}"), 1000 * S + number * 500 * S)
    return str(tmp_path / "bag")


async def test_keys_step_pause_and_change_the_rate(dds: World, terminal: Terminal, bag: str) -> None:
    heard: list[str] = []
    node = dds.node("robot", enable_rosout=False, parameter_events=False)
    node.create_subscription(String, "words", lambda message: heard.append(message.data), qos=QoSProfile(depth=100))
    await terminal.start("bag", "play", bag, "--start-paused")
    await until(lambda: "paused; space: pause" in terminal.seen, 25)
    terminal.press(RIGHT)
    await until(lambda: heard == ["w0"], 25)
    terminal.press(UP + UP + DOWN)
    await until(lambda: "at 1.1 times the rate" in terminal.seen, 25)
    terminal.press(SPACE)
    await until(lambda: ", paused" not in terminal.last, 25)
    terminal.press(RIGHT + SPACE + RIGHT[:1])  # no step while it plays
    await until(lambda: ", paused" in terminal.last, 25)
    terminal.press(RIGHT[1:] + RIGHT)
    await until(lambda: heard == ["w0", "w1", "w2"], 25)
    terminal.press(SPACE)
    assert await terminal.ended() == 0
    assert terminal.state() == terminal.before
    assert "published 3 messages of 1 topics" in terminal.seen


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGQUIT, -signal.SIGQUIT), (signal.SIGHUP, -signal.SIGHUP)],
)
async def test_the_terminal_is_as_before(dds: World, terminal: Terminal, bag: str, number: int, code: int) -> None:
    await terminal.start("bag", "play", bag, "--start-paused", "--discovery", "off")
    assert terminal.process is not None
    await until(lambda: terminal.last.endswith(", paused;"), 25)
    os.kill(terminal.process.pid, number)
    assert await terminal.ended() == code
    assert terminal.state() == terminal.before
    assert "paused" in terminal.seen and HIDE_CURSOR not in terminal.seen


async def test_a_stopped_player_gives_the_terminal_back(dds: World, terminal: Terminal, bag: str) -> None:
    await terminal.start("bag", "play", bag, "--discovery", "off")
    assert terminal.process is not None
    for _ in range(2):
        os.kill(terminal.process.pid, signal.SIGTSTP)
        await until(lambda: terminal.state() == terminal.before, 25)
        os.kill(terminal.process.pid, signal.SIGCONT)
        await until(lambda: terminal.gives_keys, 25)
    terminal.press(b"\x03")
    assert await terminal.ended() == 130
    assert terminal.state() == terminal.before


async def test_an_error_gives_the_terminal_back_too(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    """Here in the process of the test, whose terminal it is not: nothing is touched."""

    class Stream:
        def fileno(self) -> int:
            return terminal._theirs

    monkeypatch.setattr(sys, "stdin", Stream())
    with pytest.raises(ZeroDivisionError), read_keys({}) as has_keys:
        assert not has_keys and terminal.state() == terminal.before
        raise ZeroDivisionError
    assert terminal.state() == terminal.before


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
async def test_space_pauses_a_recorder(dds: World, terminal: Terminal, tmp_path: Path, end: int) -> None:
    node = dds.node("robot", enable_rosout=False, parameter_events=False)
    publisher = node.create_publisher(String, "words", QoSProfile(depth=100))
    path = tmp_path / "bag"
    await terminal.start("bag", "record", "/words", "-o", str(path), "--start-paused", "--max-cache-size", "0")
    assert terminal.process is not None
    await until(lambda: "recording /words" in terminal.seen, 25)
    await publisher.wait_for_subscribers(20)
    terminal.press(b"x ")
    await until(lambda: "recording resumed" in terminal.seen, 25)
    publisher.publish(String(data="a"))
    await until(lambda: count_of(path) == 1, 20)
    terminal.press(SPACE)
    await until(lambda: "paused" in terminal.seen.rpartition("recording resumed")[2], 25)
    os.kill(terminal.process.pid, end)
    assert await terminal.ended() == (0 if end in (signal.SIGINT, signal.SIGTERM) else -end)
    assert terminal.state() == terminal.before


@pytest.mark.parametrize(
    ("command", "line"),
    [
        (("play", "{bag}", "--start-paused"), b"paused, until the service /rosbag2_player/resume is called\n"),
        (("record", "/words", "-o", "{out}"), b"no publisher of /words yet; waiting for it\n"),
    ],
)
async def test_keys_are_left_alone_where_that_is_asked_for(
    dds: World, terminal: Terminal, bag: str, tmp_path: Path, command: tuple[str, ...], line: bytes
) -> None:
    arguments = [word.format(bag=bag, out=tmp_path / "out") for word in command]
    stream: Any = terminal._theirs
    process = await start_process(
        *(sys.executable, "-c", RUN, "bag", *arguments, "--disable-keyboard-controls", "--discovery", "off"),
        stdin=stream,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    assert process.stderr is not None
    assert await asyncio.wait_for(process.stderr.readline(), 25) == line
    assert terminal.state() == terminal.before
    process.terminate()
    _, rest = await asyncio.wait_for(process.communicate(), 25)
    assert b"space" not in rest
