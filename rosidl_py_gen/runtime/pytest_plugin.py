"""Fixtures for tests of programs that use this package: nodes that meet in memory, without network.

Loaded by pytest through the entry point ``rosidl_py_gen``; imports the runtime when a fixture is used. Decides that the
nodes of a test share its event loop, whichever it is, and that a test fails whose callbacks fail or never run: with the
callback's own exception, or, when it has failed already, with a section that shows the traceback.
"""

from __future__ import annotations

import re
import sys
import threading
import traceback
from contextlib import ExitStack, suppress
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Generator, Iterator
    from types import TracebackType

    from rosidl_py_gen.runtime.loop.virtual_time import VirtualTimeLoop
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport


_PACKAGE = str(Path(__file__).parents[1])
_LOOK_S = 0.005


class RosErrors:
    """What callbacks, handlers and other functions of the program raised in this test.

    The test fails with it, unless it said before its end that this was to be expected.
    """

    def __init__(self) -> None:
        self.found: list[BaseException] = []
        """All exceptions so far, oldest first."""
        self._judged = 0
        self._expected: list[tuple[type[BaseException], str]] = []

    def expect(self, kind: type[BaseException], match: str = "") -> None:
        """Expect callbacks to raise `kind`, with a text that `match` is found in (`re.search`), once or more.

        The test fails when none does.
        """
        if not (isinstance(kind, type) and issubclass(kind, BaseException)):
            raise TypeError(f"expect takes an exception class such as ValueError, got {kind!r:.100}")
        re.compile(match)
        self._expected.append((kind, match))

    async def wait(self, count: int = 1, timeout_s: float = 5.0) -> list[BaseException]:
        """Wait until so many exceptions were raised in all, and return them; `WaitTimeoutError` when they were not."""
        import asyncio

        from rosidl_py_gen.runtime.time.deadline import WaitTimeoutError

        now_s = asyncio.get_running_loop().time
        end_s = now_s() + timeout_s
        while len(self.found) < count:
            if now_s() > end_s:
                raise WaitTimeoutError(f"{len(self.found)} callbacks failed in {timeout_s} s, expected {count}")
            await asyncio.sleep(_LOOK_S)
        return list(self.found)

    def _judge(self, *, is_over: bool = True) -> list[BaseException]:
        """What was not expected among the exceptions since the last call; when all `is_over`, what is missing, too."""
        new, self._judged = self.found[self._judged :], len(self.found)
        wrong = [_shortened(error) for error in new if not any(_is(error, *wanted) for wanted in self._expected)]
        for kind, match in self._expected if is_over else ():
            if not any(_is(error, kind, match) for error in self.found):
                what = f"{kind.__name__} with {match!r}" if match else kind.__name__
                wrong.append(AssertionError(f"no callback raised {what}, which this test expects"))
        return wrong


def _is(error: BaseException, kind: type[BaseException], match: str) -> bool:
    return isinstance(error, kind) and re.search(match, str(error)) is not None


def _shortened(error: BaseException) -> BaseException:
    """The error with a traceback that begins in the program, if it comes by there."""
    trace: TracebackType | None = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename.startswith(_PACKAGE):
        trace = trace.tb_next
    return error if trace is None else error.with_traceback(trace)


def _as_one(errors: list[BaseException]) -> BaseException:
    from rosidl_py_gen.runtime.loop.callback_failures import CallbackFailedError

    return errors[0] if len(errors) == 1 else CallbackFailedError(errors)


_ERRORS = pytest.StashKey[RosErrors]()
_CONTEXTS = pytest.StashKey["list[Context]"]()
_STARTS = pytest.StashKey["_LoopStarts"]()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, None]:
    """Fail a test whose callbacks failed."""
    if (starts := item.stash.get(_STARTS, None)) is not None:
        starts.watch()
    outcome = yield
    errors = item.stash.get(_ERRORS, None)
    if errors is not None:
        for context in item.stash.get(_CONTEXTS, []):
            unserved = (context._core.unserved(scope) for scope in context._core.scopes)
            errors.found += [error for error in unserved if error is not None]
    wrong = [] if errors is None else errors._judge(is_over=outcome.excinfo is None)
    if wrong and outcome.excinfo is None:
        outcome.force_exception(_as_one(wrong))
    elif wrong:
        shown = "\n".join("".join(traceback.format_exception(error)) for error in wrong)
        item.add_report_section("call", "callbacks that failed", shown)


@pytest.fixture
def ros_errors(request: pytest.FixtureRequest) -> Iterator[RosErrors]:
    """What callbacks raise in this test, of whatever node: the test fails with it unless it was expected.

    ``ros_errors.expect(ValueError, match="too fast")`` in the test, before or after it happened.
    """
    from rosidl_py_gen.runtime.logs.loggers import failure_listeners

    request.node.stash[_ERRORS] = errors = RosErrors()
    with failure_listeners.add(lambda _, error: errors.found.append(error)):
        yield errors
    if late := errors._judge(is_over=False):  # while nodes were closed
        raise _as_one(late)


@pytest.fixture
def ros_loop() -> Iterator[VirtualTimeLoop]:
    """An event loop on which waiting takes no time: ``ros_loop.run(main())`` instead of ``asyncio.run(main())``.

    The clocks of `ros_domain` and of the nodes of `ros_node` go as it does in a test that has it.
    """
    from rosidl_py_gen.runtime.loop.virtual_time import VirtualTimeLoop

    loop = VirtualTimeLoop()
    yield loop
    loop.close()


@pytest.fixture
def ros_domain(request: pytest.FixtureRequest, ros_errors: RosErrors) -> MemoryTransport:
    """A fresh `MemoryTransport`; give it to every `Context` of the test. Callbacks that fail, fail the test."""
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport

    if "ros_loop" in request.fixturenames:
        loop: VirtualTimeLoop = request.getfixturevalue("ros_loop")
        return MemoryTransport(loop.clocks)
    return MemoryTransport()


class _LoopStarts:
    """Calls `start` in each event loop that begins to run in this thread, as its first callback, until `close`.

    Loops are watched when they are entered, and not when they are made: pytest-asyncio and anyio make theirs before our
    fixtures, and enter them anew for each fixture and test.
    """

    def __init__(self, start: Callable[[asyncio.AbstractEventLoop], None]) -> None:
        self._start = start
        self._thread = threading.get_ident()
        self._entries: dict[Any, Callable[[Any], None]] = {}
        self.watch()

    def watch(self) -> None:
        """Watch all kinds of loops that are loaded by now."""
        import asyncio

        kinds: list[Any] = [asyncio.BaseEventLoop]
        # anyio imports it between our last look and the test.
        if "uvloop" in sys.modules or ("anyio" in sys.modules and find_spec("uvloop") is not None):
            kinds.append(import_module("uvloop").Loop)
        for kind in kinds:
            if kind not in self._entries:
                self._entries[kind] = enter = kind.run_forever
                kind.run_forever = self._watched(enter)

    def _watched(self, enter: Callable[[Any], None]) -> Callable[[Any], None]:
        def run_forever(loop: asyncio.AbstractEventLoop) -> None:
            if threading.get_ident() == self._thread:
                loop.call_soon(self._start, loop)
            enter(loop)

        return run_forever

    def close(self) -> None:
        """Leave loops alone."""
        for kind, enter in self._entries.items():
            kind.run_forever = enter


@pytest.fixture
def ros_node(request: pytest.FixtureRequest, ros_domain: MemoryTransport) -> Iterator[Callable[..., Node]]:
    """A function ``ros_node(name, namespace="", args=())`` that makes nodes of `ros_domain`, closed after the test.

    Each node has a context of its own, as if it were another process; `args` is its command line. Nodes may be made
    before the test's event loop runs: whichever it is, it serves all of them. Callbacks that fail, fail the test, and
    so do those that no loop ran; see `ros_errors`.
    """
    from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError
    from rosidl_py_gen.runtime.node.context import Context
    from rosidl_py_gen.runtime.node.node import Node

    contexts: list[Context] = request.node.stash.setdefault(_CONTEXTS, [])

    def attach_all() -> None:
        for context in contexts:
            context._core.bridge.adopt_running_loop()

    def serve(loop: asyncio.AbstractEventLoop) -> None:
        if not any(context._core.bridge.is_shared(loop) for context in contexts):  # of a blocking call
            with suppress(WrongEventLoopError):
                attach_all()

    with ExitStack() as stack:
        starts = request.node.stash[_STARTS] = _LoopStarts(serve)
        stack.callback(starts.close)

        def make(name: str, namespace: str = "", args: tuple[str, ...] = ()) -> Node:
            context = stack.enter_context(Context(0, transport=ros_domain, args=["test", *args]))
            contexts.append(context)
            context._core.bridge.on_start(attach_all)
            return stack.enter_context(Node(name, namespace, context=context))

        yield make
