"""Nodes for programs that use asyncio."""

from __future__ import annotations

import asyncio
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy._classes import checked_attribute
from rclpy.clock_type import ClockType
from rclpy.constants import S_TO_NS
from rclpy.experimental.async_client import AsyncClient
from rclpy.experimental.async_clock import AsyncClock
from rclpy.experimental.async_publisher import AsyncPublisher
from rclpy.experimental.async_service import AsyncService
from rclpy.experimental.async_subscription import AsyncSubscription
from rclpy.experimental.async_timer import AsyncTimer
from rclpy.impl.async_entities import TaskGroup
from rclpy.node import BaseNode
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_rosout_default, qos_profile_services_default
from rclpy.subscription import Subscription
from rclpy.type_support import message_class

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

    from typing_extensions import Self

    from rclpy.context import Context
    from rclpy.handles import ContextHandle
    from rclpy.parameter import Parameter
    from rclpy.subscription_content_filter_options import ContentFilterOptions

if TaskGroup is None:
    raise ImportError("rclpy.experimental.async_node: got Python 3.10; expected 3.11 or later, for asyncio.TaskGroup")
_E = TypeVar("_E", AsyncSubscription, AsyncService, AsyncClient, AsyncTimer)
AsyncEntity = AsyncPublisher | AsyncSubscription | AsyncService | AsyncClient | AsyncTimer


class AsyncNode(BaseNode):
    """Node whose callbacks run as tasks of asyncio, without an executor.

    Callbacks run from ``async with node`` to the end of the block, which destroys the node. An exception of a callback
    ends the block: the exception is raised there in an ExceptionGroup.

    Args: see `rclpy.node.Node`.

    Example:
        >>> async with AsyncNode("listener") as node:  # doctest: +SKIP
        ...     node.create_subscription(String, "chatter", print, 10)
        ...     await asyncio.sleep(10)
    """

    def __init__(
        self,
        node_name: str,
        *,
        context: Context | None = None,
        cli_args: list[str] | None = None,
        namespace: str | None = None,
        use_global_arguments: bool = True,
        enable_rosout: bool = True,
        rosout_qos_profile: QoSProfile | int = qos_profile_rosout_default,
        start_parameter_services: bool = True,
        parameter_overrides: list[Parameter] | None = None,
        allow_undeclared_parameters: bool = False,
        automatically_declare_parameters_from_overrides: bool = False,
        enable_logger_service: bool = False,
    ) -> None:
        self._rosidl_clock: AsyncClock = AsyncClock(clock_type=ClockType.ROS_TIME)
        self._clock: AsyncClock = self._rosidl_clock
        self._rosidl_task_group: Any = None
        self._rosidl_entities: set[AsyncEntity] = set()
        self._rosidl_destroyed = asyncio.Event()
        super().__init__(
            node_name,
            context=context,
            cli_args=cli_args,
            namespace=namespace,
            use_global_arguments=use_global_arguments,
            enable_rosout=enable_rosout,
            rosout_qos_profile=rosout_qos_profile,
            start_parameter_services=start_parameter_services,
            parameter_overrides=parameter_overrides,
            allow_undeclared_parameters=allow_undeclared_parameters,
            automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
            enable_logger_service=enable_logger_service,
        )

    async def __aenter__(self) -> Self:
        if self._rosidl_destroyed.is_set():
            raise RuntimeError("Node has been destroyed and cannot be reentered")
        if self._rosidl_task_group is not None:
            raise RuntimeError("Node is already running")
        self._rosidl_task_group = await TaskGroup().__aenter__()
        self._rosidl_entered_context: ContextHandle = self.handle.context
        self._rosidl_entered_context.start_loop_thread()
        for entity in tuple(self._rosidl_entities):
            if not isinstance(entity, AsyncPublisher):
                entity.rosidl_task.start(self._rosidl_task_group)
        return self

    async def __aexit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        task_group = self._rosidl_task_group
        try:
            self.destroy_node()
            await task_group.__aexit__(exc_type, exc_val, exc_tb)
        finally:
            self._rosidl_task_group = None
            self._rosidl_entered_context.stop_loop_thread()

    async def run(self) -> None:
        """Run the callbacks of the node until `destroy_node`; raise RuntimeError if the node runs already."""
        async with self:
            await self._rosidl_destroyed.wait()

    def get_clock(self) -> AsyncClock:
        """Return the clock of ROS time, which may be simulated."""
        return checked_attribute("_clock", self._clock, "now")

    def destroy_node(self) -> None:
        """Destroy the node and its entities, and cancel the callbacks that are running."""
        if self._rosidl_destroyed.is_set():
            return
        self._rosidl_destroyed.set()
        for entity in tuple(self._rosidl_entities):
            entity.destroy()
        self._rosidl_clock.rosidl_destroy_clock()
        super().destroy_node()

    async def wait_for_node(self, fully_qualified_node_name: str, *, check_interval: float = 0.1) -> None:
        """Wait until a node is in the graph; `asyncio.timeout` limits the time.

        Args:
            check_interval: seconds between two checks.
        """
        name = "/" + fully_qualified_node_name.removeprefix("/")
        while name not in self.get_fully_qualified_node_names():
            await asyncio.sleep(check_interval)

    def _rosidl_require_open(self, kind: str) -> None:
        if self._rosidl_destroyed.is_set():
            raise RuntimeError(f"Cannot create {kind} on a destroyed node")

    def create_publisher(self, msg_type: type[Any], topic: str, qos_profile: QoSProfile | int) -> AsyncPublisher:
        """Create a publisher; `qos_profile` may be a depth.

        Raises:
            RuntimeError: the node was destroyed.
        """
        self._rosidl_require_open("publisher")
        profile = self._rosidl_to_profile(qos_profile)
        create = partial(self.handle.entity.create_publisher, message_class(msg_type), topic)
        handle = self._rosidl_create_on_topic(Publisher, msg_type, topic, profile, None, None, create)
        publisher = AsyncPublisher(handle, msg_type, topic, profile, on_destroy=self._rosidl_entities.discard)
        self._rosidl_entities.add(publisher)
        return publisher

    def create_subscription(
        self,
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        raw: bool = False,
        concurrent: bool = False,
        content_filter_options: ContentFilterOptions | None = None,
    ) -> AsyncSubscription:
        """Create a subscription; `qos_profile` may be a depth.

        Args:
            callback: function, plain or async, that takes the message, or the message and a dict about it.
            raw: pass messages as bytes.
            concurrent: start each callback in a task of its own; else the next message waits for the end of the
                callback.
            content_filter_options: filter of the messages, see `AsyncSubscription.set_content_filter`.

        Raises:
            RuntimeError: the node was destroyed, or the callback does not take one or two arguments.
            RCLError: the filter is invalid.
        """
        self._rosidl_require_open("subscription")
        profile = self._rosidl_to_profile(qos_profile)
        create = partial(self.handle.entity.create_subscription, message_class(msg_type), topic, raw=raw)
        min_depth = self._rosidl_min_depth(content_filter_options)
        handle = self._rosidl_create_on_topic(Subscription, msg_type, topic, profile, None, None, create, min_depth)
        try:
            subscription = AsyncSubscription(
                handle, msg_type, topic, callback, profile, self._rosidl_entities.discard, raw, concurrent
            )
            if content_filter_options is not None:
                subscription.set_content_filter(*content_filter_options)
        except Exception:
            handle.destroy_when_not_in_use()
            raise
        return self._rosidl_start(subscription)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        concurrent: bool = False,
    ) -> AsyncService:
        """Create a service whose callback takes a request and an empty response, and returns the response.

        Args:
            concurrent: start each callback in a task of its own; else the next request waits for the end of the
                callback.

        Raises:
            RuntimeError: the node was destroyed.
        """
        self._rosidl_require_open("service")
        handle = self._rosidl_create_on_service("service", srv_type, srv_name, qos_profile)
        discard = self._rosidl_entities.discard
        return self._rosidl_start(AsyncService(handle, srv_type, srv_name, callback, qos_profile, discard, concurrent))

    def create_client(
        self, srv_type: Any, srv_name: str, *, qos_profile: QoSProfile = qos_profile_services_default
    ) -> AsyncClient:
        """Create a client of a service; raise RuntimeError if the node was destroyed."""
        self._rosidl_require_open("client")
        handle = self._rosidl_create_on_service("client", srv_type, srv_name, qos_profile)
        discard = self._rosidl_entities.discard
        return self._rosidl_start(AsyncClient(self._rosidl_context, handle, srv_type, srv_name, qos_profile, discard))

    def create_timer(self, timer_period_sec: float, callback: Callable[..., Any], autostart: bool = True) -> AsyncTimer:
        """Call a function, plain or async, every `timer_period_sec` seconds of the node's clock.

        Without `autostart`, the timer starts with `AsyncTimer.reset`.

        Raises:
            RuntimeError: the node was destroyed, or the callback takes more than one argument.
        """
        self._rosidl_require_open("timer")
        period_ns = int(float(timer_period_sec) * S_TO_NS)
        discard = self._rosidl_entities.discard
        clock, context = self._rosidl_clock, self._rosidl_context
        return self._rosidl_start(AsyncTimer(period_ns, clock, context, callback, autostart, discard))

    def _rosidl_start(self, entity: _E) -> _E:
        self._rosidl_entities.add(entity)
        if self._rosidl_task_group is not None:
            entity.rosidl_task.start(self._rosidl_task_group)
        return entity
