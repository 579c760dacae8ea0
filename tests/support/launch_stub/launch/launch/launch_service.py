"""The service: one asyncio loop in the main thread, which signals wake up by a file descriptor."""

from __future__ import annotations

import asyncio
import signal
import socket
from collections.abc import Callable, Coroutine
from contextlib import closing
from typing import Any

from launch.core import Context


class AsyncSafeSignalManager:
    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop, self._handlers = loop, dict[int, Callable[[int], None]]()

    def __enter__(self) -> AsyncSafeSignalManager:
        self._read, self._write = socket.socketpair()
        self._read.setblocking(False)
        self._write.setblocking(False)
        self._loop.add_reader(self._read.fileno(), self._on_signal)
        self._previous = signal.set_wakeup_fd(self._write.fileno())
        return self

    def __exit__(self, *given: object) -> None:
        signal.set_wakeup_fd(self._previous)
        self._loop.remove_reader(self._read.fileno())
        self._read.close()
        self._write.close()

    def _on_signal(self) -> None:
        for number in self._read.recv(4096):
            if number in self._handlers:
                self._handlers[number](number)

    def handle(self, number: int, handler: Callable[[int], None]) -> None:
        self._handlers[number] = handler


class LaunchService:
    def __init__(self, *, argv: list[str], noninteractive: bool, debug: bool) -> None:
        self._context = Context(self)
        self._waiting: list[Any] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_shut_down = False
        print(f"argv {argv} noninteractive {noninteractive} debug {debug}", flush=True)

    def include_launch_description(self, description: Any) -> None:
        self._waiting.append(description)

    def add(self, work: Coroutine[Any, Any, None]) -> None:
        self._tasks.add(asyncio.get_running_loop().create_task(work))

    def shutdown(self, force_sync: bool = False) -> None:
        if not self._is_shut_down:
            self._is_shut_down = True
            for function in self._context.on_shutdown:
                function()

    def run(self) -> int:
        loop = asyncio.new_event_loop()
        task = loop.create_task(self._run(loop))
        with closing(loop):
            while True:
                try:
                    return loop.run_until_complete(task)
                except KeyboardInterrupt:
                    continue

    async def _run(self, loop: asyncio.AbstractEventLoop) -> int:
        task = asyncio.current_task()
        assert task is not None
        with AsyncSafeSignalManager(loop) as manager:
            manager.handle(signal.SIGINT, lambda number: self.shutdown())
            manager.handle(signal.SIGTERM, lambda number: task.cancel())
            code = 0
            try:
                for entity in self._waiting:
                    self._visit(entity)
            except Exception as error:
                print(f"[ERROR] [launch]: Caught exception in launch: {error}", flush=True)
                code = 1
                self.shutdown()
            while self._tasks:
                await asyncio.wait(self._tasks, timeout=0.1)
                self._tasks = {one for one in self._tasks if not one.done()}
            self.shutdown()
            return code

    def _visit(self, entity: Any) -> None:
        for one in entity.visit(self._context) or ():
            self._visit(one)
