"""Commands on the event loop of the test, beside its nodes in memory: no process, no network, no time."""

from __future__ import annotations

import asyncio
import contextvars
import io
import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import ros_cli
from rosidl_py_gen.ros_cli import command_node
from rosidl_py_gen.runtime import Context

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pytest

    from support.node_fixtures import World

_HERE: contextvars.ContextVar[dict[str, Pipe]] = contextvars.ContextVar("streams of the command that runs here")


class Pipe:
    """Output of a command, which is read as from `asyncio.subprocess`."""

    def __init__(self) -> None:
        self.text = ""
        self._read = 0
        self._changed = asyncio.Event()
        self._is_ended = False

    def write(self, text: str) -> None:
        self.text += text
        self._changed.set()

    def end(self) -> None:
        self._is_ended = True
        self._changed.set()

    async def readline(self) -> bytes:
        """The next line; empty at the end."""
        while (end := self.text.find("\n", self._read)) < 0 and not self._is_ended:
            self._changed.clear()
            await self._changed.wait()
        line, self._read = self.text[self._read : end + 1], end + 1 if end >= 0 else len(self.text)
        return line.encode()

    async def read(self) -> bytes:
        """All that was not read yet."""
        lines = [line async for line in self]
        return b"".join(lines)

    async def readuntil(self, separator: bytes) -> bytes:
        """Up to some text and with it."""
        found = b""
        while separator not in found:
            line = await self.readline()
            assert line, f"{separator!r} never came: {found!r}"
            found += line
        return found

    def __aiter__(self) -> Pipe:
        return self

    async def __anext__(self) -> bytes:
        line = await self.readline()
        if not line:
            raise StopAsyncIteration
        return line


class _Stream(io.TextIOBase):
    """Replacement of `sys.stdout` or `sys.stderr`: each command writes into its own pipe."""

    encoding, errors = "utf-8", "strict"

    def __init__(self, name: str, otherwise: Any) -> None:
        self._name, self._otherwise = name, otherwise

    def write(self, text: str) -> int:
        streams = _HERE.get(None)
        (self._otherwise if streams is None else streams[self._name]).write(text)
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return False


class _Captured(BaseException):
    """The command line was read; this is what it asks for."""


class Command:
    """A command under way, with what tests use of `asyncio.subprocess.Process`."""

    def __init__(self, job: ros_cli.AsyncCommand | None, streams: dict[str, Pipe], code: int | None) -> None:
        self.stdout, self.stderr = streams["stdout"], streams["stderr"]
        self.returncode = code
        self._job = job
        self._task: asyncio.Task[None] | None = None
        if job is None:
            self._end(code or 0)
        else:
            context = contextvars.copy_context()
            context.run(_HERE.set, streams)
            self._task = context.run(asyncio.ensure_future, self._run(job))

    async def _run(self, job: ros_cli.AsyncCommand) -> None:
        code = 1
        try:
            with ros_cli.exit_on_error():
                code = await job.main or 0
        except SystemExit as end:
            code = int(str(end.code))
        except asyncio.CancelledError:
            code = 0 if job.endless else 130
        finally:
            self._end(code)

    def _end(self, code: int) -> None:
        self.returncode = code
        self.stdout.end()
        self.stderr.end()

    def send_signal(self, number: int) -> None:
        assert number in (signal.SIGINT, signal.SIGTERM)
        if self._task is not None:
            self._task.cancel()

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    kill = terminate

    async def wait(self) -> int:
        if self._task is not None:
            await asyncio.wait((self._task,))
        assert self.returncode is not None
        return self.returncode

    async def communicate(self, data: bytes | None = None) -> tuple[bytes, bytes]:
        """All output, at the end."""
        await self.wait()
        return self.stdout.text.encode(), self.stderr.text.encode()


def start(world: World, patch: pytest.MonkeyPatch, arguments: tuple[str, ...], stdin: str) -> Command:
    """Begin a command in a world of memory."""

    @contextmanager
    def listening(network: command_node.NetworkOptions) -> Iterator[None]:
        try:
            options: Any = {"discovery": network.get("discovery"), "announce_delay_s": command_node._ANNOUNCE_DELAY_S}
            context = Context(network.get("domain_id"), args=[], transport=world.transport, **options)
            network["context"] = context
            world.contexts.append(context)
        except Exception as error:
            network["failure"] = error
        yield

    def capture(job: ros_cli.AsyncCommand) -> int:
        raise _Captured(job)

    for name in ("stdout", "stderr"):
        if not isinstance(getattr(sys, name), _Stream):
            patch.setattr(sys, name, _Stream(name, getattr(sys, name)))
    patch.setattr(sys, "stdin", io.StringIO(stdin))
    streams = {"stdout": Pipe(), "stderr": Pipe()}

    def parse() -> tuple[ros_cli.AsyncCommand | None, int]:
        _HERE.set(streams)
        with patch.context() as patched:
            patched.setattr(command_node, "context_opened_early", listening)
            patched.setattr(ros_cli, "run_async_command", capture)
            try:
                ros_cli.main([*arguments])
            except _Captured as captured:
                return captured.args[0], 0
            except SystemExit as end:
                return None, int(str(end.code or 0))
        return None, 0

    job, code = contextvars.copy_context().run(parse)
    return Command(job, streams, None if job is not None else code)
