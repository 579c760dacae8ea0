"""What hands messages on, and where they come from.

Decides that filters make chains: one calls back for what it lets through, and another one may be what it calls back.
Plain callbacks are called at once, where the message came. The coroutine of an async one is what `signal_message`
answers, so that whoever called first, a subscription mostly, awaits it and hears of its failure.
"""

from __future__ import annotations

import asyncio
import inspect
from collections import deque
from functools import partial
from math import isfinite
from types import CoroutineType
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.base.registration import Registration, RegistrationSet
from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.base.stamps import NS_PER_S
from rosidl_py_gen.base.waiters import Waiters
from rosidl_py_gen.message_filters.stamps import StampError, header_stamp
from rosidl_py_gen.runtime import CallbackInUseError, ClosedError, Duration, WaitTimeoutError

if TYPE_CHECKING:
    from collections.abc import Callable, Coroutine, Iterable

    from typing_extensions import Self

    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.runtime import Clock, Node, QoSProfile

DEPTH = 10


class MessageFilter:
    """Hands on what it is given: the start of a chain that is fed by hand, and what all filters have.

    With a callback it calls that; without any, what comes out waits until it is received, and when `queue_size` wait,
    the oldest goes.

    Args:
        callback: plain or async; an async one is awaited set by set.
        queue_size: how much waits for who receives, or for an async callback.
    """

    def __init__(self, callback: Callable[..., object] | None = None, *, queue_size: int = DEPTH) -> None:
        self._setup(callback, 1, queue_size, ())

    def _setup(
        self, callback: Callable[..., object] | None, width: int, queue_size: int, inputs: tuple[MessageFilter, ...]
    ) -> None:
        self._width, self._depth = width, check_queue_size("queue_size", queue_size)
        self._outputs: RegistrationSet[_Output] = RegistrationSet()
        self._waiting: deque[Any] = deque(maxlen=self._depth)
        self._waiters = Waiters()
        self._links: list[Registration] = []
        self._watching: asyncio.Task[None] | None = None
        self._closed = False
        self.dropped = 0
        """What nobody received in time."""
        self._inputs = inputs
        self._nodes: tuple[Node, ...] = tuple({id(node): node for one in inputs for node in one._nodes}.values())
        if callback is not None:
            self.register_callback(callback)

    # ------------------------------------------------------------------------------------------------------- callbacks

    def register_callback(self, callback: Callable[..., object]) -> Registration:
        """Call it, plain or async, with what comes out, until the answer is closed; several are called in their order.

        Raises:
            CallbackSignatureError, TypeError: it cannot be called with so many messages.
        """
        if not callable(callback):
            raise TypeError(f"the callback of {self!r} must be a function, got {callback!r:.100}")
        words = ["the message"] if self._width == 1 else [f"message {number + 1}" for number in range(self._width)]
        require_signature(callback, f"the callback of {type(self).__name__}", *words)
        self._waiting.clear()
        return self._outputs.add(_Output(self, callback, self._depth))

    def signal_message(self, *messages: Any) -> Coroutine[Any, Any, None] | None:
        """Hand on, as if it had come out.

        Returns:
            What is to be awaited; None unless a callback is async.
        """
        if self._closed:
            return None
        if not len(self._outputs):
            self._count(self._waiting)
            self._waiting.append(messages[0] if self._width == 1 else messages)
            self._waiters.wake()
            return None
        return call_all(partial(output.call, messages) for output in self._outputs)

    def _count(self, waiting: deque[Any]) -> None:
        self.dropped += len(waiting) == waiting.maxlen

    # ------------------------------------------------------------------------------------------------------- receiving

    def __aiter__(self) -> Self:
        self._require_no_callback()
        return self

    async def __anext__(self) -> Any:
        if not await self._wait(None):
            raise StopAsyncIteration
        return self._waiting.popleft()

    async def receive(self, timeout_s: float | None = None) -> Any:
        """The next message, or the next set of them, oldest first.

        Raises:
            WaitTimeoutError: none came in `timeout_s` seconds.
            ClosedError: this was closed, or a node that feeds it.
        """
        self._require_no_callback()
        if await self._wait(timeout_s):
            return self._waiting.popleft()
        if self._closed:
            raise ClosedError(f"{self!r} is closed")
        raise WaitTimeoutError(f"nothing came out of {self!r} in {timeout_s} s", "; ".join(await self._why_silent()))

    async def _why_silent(self) -> list[str]:
        """Return why inputs receive nothing, where that is known."""
        return [reason for one in self._inputs for reason in await one._why_silent()]

    async def _wait(self, timeout_s: float | None) -> bool:
        """Whether something waits; False when the time passed or this ended."""
        if not self._waiting and not self._closed and self._watching is None and self._nodes:
            self._watching = asyncio.ensure_future(self._watch())
        await self._waiters.wait(lambda: self._waiting or self._closed, timeout_s)
        return bool(self._waiting)

    async def _watch(self) -> None:
        """Close when a node does, which nobody else would tell who waits."""
        ends = [asyncio.ensure_future(_wait_node_closed(node)) for node in self._nodes]
        try:
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            self.close()
        finally:
            for end in ends:
                end.cancel()

    def _require_no_callback(self) -> None:
        if len(self._outputs):
            raise CallbackInUseError(f"{self!r} has a callback; it cannot be received from too")

    # --------------------------------------------------------------------------------------------------------- chains

    def _clock(self) -> Clock | None:
        """That of the first node that feeds this."""
        return self._nodes[0].clock if self._nodes else None

    def _clear_on_time_jump(self, clear: Callable[[], object]) -> None:
        """When the time of a node jumps back, as when a bag is played again, messages of before never match again."""
        for node in self._nodes:
            self._links.append(
                node.clock.create_jump_callback(
                    post=lambda _: _ignored(clear()), on_clock_change=True, min_backward=Duration(nanoseconds=-1)
                )
            )

    def close(self) -> None:
        """Let nothing through any more; what was not received still can be. The inputs go on. May be called twice."""
        self._closed = True
        for link in self._links:
            link.close()
        if self._watching is not None and self._watching.get_loop() is _loop():
            self._watching.cancel()
        self._waiters.wake()

    def __repr__(self) -> str:
        return f"<{type(self).__name__}{' closed' if self._closed else ''}>"


class Subscriber(MessageFilter):
    """A subscription as the beginning of a chain.

    Args:
        node: whose subscription it is.
        msg_type: a message class, or the name of a type: messages are dicts then.
        topic: as that of `Node.create_subscription`.
        qos: a depth or a profile.
        callback: see `MessageFilter`.
        options: what `Node.create_subscription` takes besides.
    """

    def __init__(
        self,
        node: Node,
        msg_type: type[Message] | str,
        topic: str,
        qos: QoSProfile | int = DEPTH,
        *,
        callback: Callable[..., object] | None = None,
        **options: Any,
    ) -> None:
        self._setup(None, 1, DEPTH, ())
        self._nodes = (node,)
        self._msg_type = msg_type
        self._has_bytes = bool(options.get("raw"))
        self.subscription = node.create_subscription(msg_type, topic, self.signal_message, qos, **options)
        """Its figures are there: `dropped`, `publisher_count`, `wait_for_publishers`."""
        if callback is not None:
            self.register_callback(callback)

    async def _why_silent(self) -> list[str]:
        try:
            await self.subscription.wait_for_publishers(0)
        except WaitTimeoutError as error:
            return [f"{self.subscription.topic}: {error.reason}"] if error.reason else []
        return []

    def close(self) -> None:
        """Close the subscription, too."""
        self.subscription.close()
        super().close()

    def __repr__(self) -> str:
        return f"<Subscriber of {self.subscription.topic}{' closed' if self._closed else ''}>"


def require_stamps(source: MessageFilter) -> None:
    """Raise `StampError` where it is known that no message of `source` will have one."""
    if not isinstance(source, Subscriber):
        return
    cls: Any = get_message(source._msg_type) if isinstance(source._msg_type, str) else source._msg_type
    if source._has_bytes or header_stamp(cls()) is None:
        what = "bytes" if source._has_bytes else source.subscription.message_type
        raise StampError(f"{source.subscription.topic}: {what} has no header.stamp to go by")


class _Output:
    """A callback; an async one has a queue of its own, and calls of it come one after the other."""

    def __init__(self, owner: MessageFilter, function: Callable[..., Any], depth: int) -> None:
        self._owner, self._function = owner, function
        called = getattr(type(function), "__call__", None)  # noqa: B004 - the method itself, not whether there is one
        self._is_async = inspect.iscoroutinefunction(function) or inspect.iscoroutinefunction(called)
        self._waiting: deque[tuple[Any, ...]] = deque(maxlen=depth)
        self._turn = asyncio.Lock()
        self._under_way = 0

    def call(self, messages: tuple[Any, ...]) -> Coroutine[Any, Any, None] | None:
        if not self._is_async:
            answer = self._function(*messages)
            return answer if isinstance(answer, CoroutineType) else None
        self._owner._count(self._waiting)
        self._waiting.append(messages)
        if self._under_way > len(self._waiting):  # there are enough to take all
            return None
        self._under_way += 1
        return self._run()

    async def _run(self) -> None:
        try:
            async with self._turn:
                if self._waiting:
                    await self._function(*self._waiting.popleft())
        finally:
            self._under_way -= 1


def call_all(calls: Iterable[Callable[[], Coroutine[Any, Any, None] | None]]) -> Coroutine[Any, Any, None] | None:
    """Call each, also behind one that fails; what is to be awaited of their answers, and raises the first failure."""
    begun: list[Coroutine[Any, Any, None]] = []
    failures: list[Exception] = []
    for call in calls:
        try:
            answer = call()
        except Exception as error:
            failures.append(error)
            continue
        if answer is not None:
            begun.append(answer)
    if begun:
        return begun[0] if len(begun) == 1 and not failures else _await_all(begun, failures)
    if failures:
        raise failures[0]
    return None


async def _await_all(begun: list[Coroutine[Any, Any, None]], failures: list[Exception]) -> None:
    answers = await asyncio.gather(*begun, return_exceptions=True)
    for failure in (*failures, *answers):
        if failure is not None:
            raise failure


async def _wait_node_closed(node: Node) -> None:
    async for _ in node.graph_changes():
        pass


def _ignored(_: object) -> None:
    """What a callback that answers nothing answers."""


def _loop() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


def check_queue_size(what: str, value: object) -> int:
    """A number of messages; raises `TypeError`, `ValueError` for none."""
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{what} must be an int, how many messages are kept, got {value!r:.100}")
    if value < 1:
        raise ValueError(f"{what} must be 1 or more, got {value}")
    return value


def slop_to_ns(what: str, seconds: object) -> int:
    """Seconds as nanoseconds; raises `TypeError`, `ValueError` for no number, a negative one, infinity and NaN."""
    if not isinstance(seconds, int | float) or isinstance(seconds, bool):
        raise TypeError(f"{what} must be a number of seconds, got {seconds!r:.100}")
    if not isfinite(seconds) or seconds < 0:
        raise ValueError(f"{what} must be 0 or more seconds, got {seconds}")
    return round(seconds * NS_PER_S)
