"""Commands on the event loop of the test, beside its nodes in memory: no process, no network, no time."""

from __future__ import annotations

import asyncio
import contextvars
import io
import signal
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import command_support, ros_cli
from rosidl_py_gen.command_support import NetworkOptions
from rosidl_py_gen.command_support.command_node import ANNOUNCE_DELAY_S
from rosidl_py_gen.runtime import Context

if TYPE_CHECKING:
    from collections.abc import Iterator

    import pytest

    from support.worlds import World

_HERE: contextvars.ContextVar[dict[str, asyncio.StreamReader]] = contextvars.ContextVar(
    "streams of the command that runs here"
)


class _Stream(io.TextIOBase):
    """Replacement of `sys.stdout` or `sys.stderr`: each command writes into its own pipe."""

    encoding, errors = "utf-8", "strict"

    def __init__(self, name: str, otherwise: Any) -> None:
        self._name, self._otherwise = name, otherwise

    def write(self, text: str) -> int:
        streams = _HERE.get(None)
        if streams is None:
            self._otherwise.write(text)
        else:
            streams[self._name].feed_data(text.encode())
        return len(text)

    def flush(self) -> None:
        pass

    def isatty(self) -> bool:
        return False


class _Captured(BaseException):
    """The command line was read; this is what it asks for."""


class Command:
    """Running command, with the part of the API of `asyncio.subprocess.Process` that tests use."""

    def __init__(
        self, job: ros_cli.AsyncCommand | None, streams: dict[str, asyncio.StreamReader], code: int | None
    ) -> None:
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
        self.stdout.feed_eof()
        self.stderr.feed_eof()

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
        """The output that was not read yet, at the end."""
        await self.wait()
        return await self.stdout.read(), await self.stderr.read()


def start(world: World, patch: pytest.MonkeyPatch, arguments: tuple[str, ...], stdin: str) -> Command:
    """Start a command in a world of memory."""

    @contextmanager
    def listening(network: NetworkOptions) -> Iterator[None]:
        try:
            options: Any = {"discovery": network.get("discovery"), "announce_delay_s": ANNOUNCE_DELAY_S}
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
    streams = {name: asyncio.StreamReader(limit=1 << 24) for name in ("stdout", "stderr")}

    def parse() -> tuple[ros_cli.AsyncCommand | None, int]:
        _HERE.set(streams)
        with patch.context() as patched:
            patched.setattr(command_support, "context_opened_early", listening)
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
