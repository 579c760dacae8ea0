"""Fixtures for tests of programs that use this package: nodes that communicate in memory, without network.

pytest loads the module through the entry point ``rosidl_py_gen``; the runtime is imported when a fixture is used. All
nodes of a test share its event loop. A test fails if a callback fails or never runs: with the exception of the
callback, or, if the test has failed already, with the traceback in a section of the report.
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

    from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop
    from rosidl_py_gen.runtime.node.context import ContextCore
    from rosidl_py_gen.runtime.node.node import Node
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport


_PACKAGE = str(Path(__file__).parents[1])
_ERROR_POLL_INTERVAL_S = 0.005


class RosErrors:
    """Exceptions of callbacks in one test; the test fails with each exception that it does not expect."""

    def __init__(self) -> None:
        self.found: list[BaseException] = []
        """All exceptions that callbacks of the test have raised so far, oldest first."""
        self._checked_count = 0
        self._expected: list[tuple[type[BaseException], str]] = []

    def expect(self, kind: type[BaseException], match: str = "") -> None:
        """Expect at least one exception of a class, with a text in which `re.search` finds `match`.

        The test fails if no callback raises such an exception.
        """
        if not (isinstance(kind, type) and issubclass(kind, BaseException)):
            raise TypeError(f"expect takes an exception class such as ValueError, got {kind!r:.100}")
        re.compile(match)
        self._expected.append((kind, match))

    async def wait(self, count: int = 1, timeout_s: float = 5.0) -> list[BaseException]:
        """Wait until callbacks have raised at least `count` exceptions, and return all of these.

        There is no blocking form, because the callbacks run on the test's event loop.

        Raises:
            WaitTimeoutError: fewer exceptions were raised within `timeout_s`.
        """
        import asyncio

        from rosidl_py_gen.runtime.time_values import WaitTimeoutError

        now_s = asyncio.get_running_loop().time
        end_s = now_s() + timeout_s
        while len(self.found) < count:
            if now_s() > end_s:
                raise WaitTimeoutError(f"{len(self.found)} callbacks failed in {timeout_s} s, expected {count}")
            await asyncio.sleep(_ERROR_POLL_INTERVAL_S)
        return list(self.found)

    def _unexpected(self, *, is_over: bool = True) -> list[BaseException]:
        """Return the exceptions of callbacks since the last call of the method that the test did not expect.

        Args:
            is_over: the test has ended: return also an error for each expected exception that no callback raised.
        """
        new, self._checked_count = self.found[self._checked_count :], len(self.found)
        errors = [_shortened(error) for error in new if not any(_fits(error, *rule) for rule in self._expected)]
        for kind, match in self._expected if is_over else ():
            if not any(_fits(error, kind, match) for error in self.found):
                text = f"{kind.__name__} with {match!r}" if match else kind.__name__
                errors.append(AssertionError(f"no callback raised {text}, which this test expects"))
        return errors


def _fits(error: BaseException, kind: type[BaseException], match: str) -> bool:
    return isinstance(error, kind) and re.search(match, str(error)) is not None


def _shortened(error: BaseException) -> BaseException:
    """Return an exception without the frames of this package at the beginning of its traceback, if others follow."""
    trace: TracebackType | None = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename.startswith(_PACKAGE):
        trace = trace.tb_next
    return error if trace is None else error.with_traceback(trace)


def _combined(errors: list[BaseException]) -> BaseException:
    from rosidl_py_gen.runtime.loop.callbacks import CallbackFailedError

    return errors[0] if len(errors) == 1 else CallbackFailedError(errors)


_ERRORS = pytest.StashKey[RosErrors]()
_CORES = pytest.StashKey["list[ContextCore]"]()
_STARTS = pytest.StashKey["_LoopStarts"]()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, None]:
    """Fail a test if callbacks of its nodes have failed or never ran."""
    if (starts := item.stash.get(_STARTS, None)) is not None:
        starts.watch()
    outcome = yield
    errors = item.stash.get(_ERRORS, None)
    if errors is not None:
        for core in item.stash.get(_CORES, []):
            never_ran = (core.take_never_ran_error(scope) for scope in core.scopes)
            errors.found += [error for error in never_ran if error is not None]
    unexpected = [] if errors is None else errors._unexpected(is_over=outcome.excinfo is None)
    if unexpected and outcome.excinfo is None:
        outcome.force_exception(_combined(unexpected))
    elif unexpected:
        text = "\n".join("".join(traceback.format_exception(error)) for error in unexpected)
        item.add_report_section("call", "callbacks that failed", text)


@pytest.fixture
def ros_errors(request: pytest.FixtureRequest) -> Iterator[RosErrors]:
    """Exceptions that callbacks of all nodes raise in this test; the test fails with each that it does not expect.

    ``ros_errors.expect(ValueError, match="too fast")`` may be called before or after the exception.
    """
    from rosidl_py_gen.runtime.logs import failure_listeners

    request.node.stash[_ERRORS] = errors = RosErrors()
    with failure_listeners.add(lambda _, error: errors.found.append(error)):
        yield errors
    if late := errors._unexpected(is_over=False):  # raised while nodes were closed
        raise _combined(late)


@pytest.fixture
def ros_loop() -> Iterator[VirtualTimeLoop]:
    """Event loop on which waiting takes no time: ``ros_loop.run(main())`` instead of ``asyncio.run(main())``.

    In a test that uses this fixture, the clocks of `ros_domain` and of the nodes of `ros_node` have the loop's time.
    """
    from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop

    loop = VirtualTimeLoop()
    yield loop
    loop.close()


@pytest.fixture
def ros_domain(request: pytest.FixtureRequest, ros_errors: RosErrors) -> MemoryTransport:
    """New `MemoryTransport` that the contexts of a test can share: ``Context(transport=ros_domain)``.

    The test fails if a callback fails.
    """
    from rosidl_py_gen.runtime.transport.memory import MemoryTransport

    if "ros_loop" in request.fixturenames:
        loop: VirtualTimeLoop = request.getfixturevalue("ros_loop")
        return MemoryTransport(loop.clocks)
    return MemoryTransport()


class _LoopStarts:
    """Hook that calls `start` as the first callback of each event loop that starts in this thread, until `close`.

    Loops are detected when they start, not when they are created: pytest-asyncio and anyio create their loops before
    the fixtures of this module, and start them for each fixture and test.
    """

    def __init__(self, start: Callable[[asyncio.AbstractEventLoop], None]) -> None:
        self._start = start
        self._thread = threading.get_ident()
        self._entries: dict[Any, Callable[[Any], None]] = {}
        self.watch()

    def watch(self) -> None:
        """Make the hook detect starts of all event loop classes that are imported now, or that anyio will import
        (uvloop).
        """
        import asyncio

        kinds: list[Any] = [asyncio.BaseEventLoop]
        # anyio imports uvloop after the fixtures and before the test
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
        """Stop detecting starts of event loops."""
        for kind, enter in self._entries.items():
            kind.run_forever = enter


@pytest.fixture
def ros_node(request: pytest.FixtureRequest, ros_domain: MemoryTransport) -> Iterator[Callable[..., Node]]:
    """Function ``ros_node(name, namespace="", args=())`` that creates nodes in `ros_domain`, closed after the test.

    Each node has its own context, as if it were in another process; `args` is its command line. Nodes may be created
    before the test's event loop runs, which serves all of them. The test fails if a callback fails or never runs,
    unless it expects that with `ros_errors`.
    """
    from rosidl_py_gen.runtime.loop.loop_binding import WrongEventLoopError
    from rosidl_py_gen.runtime.node.context import Context, core_of
    from rosidl_py_gen.runtime.node.node import Node

    cores: list[ContextCore] = request.node.stash.setdefault(_CORES, [])

    def attach_all() -> None:
        for core in cores:
            core.loop_binding.adopt_running_loop()

    def serve(loop: asyncio.AbstractEventLoop) -> None:
        if not any(core.loop_binding.is_shared(loop) for core in cores):  # the loop of a blocking call
            with suppress(WrongEventLoopError):
                attach_all()

    with ExitStack() as stack:
        starts = request.node.stash[_STARTS] = _LoopStarts(serve)
        stack.callback(starts.close)

        def make(name: str, namespace: str = "", args: tuple[str, ...] = ()) -> Node:
            context = stack.enter_context(Context(0, transport=ros_domain, args=["test", *args]))
            cores.append(core := core_of(context))
            core.loop_binding.on_bind(attach_all)
            return stack.enter_context(Node(name, namespace, context=context))

        yield make
