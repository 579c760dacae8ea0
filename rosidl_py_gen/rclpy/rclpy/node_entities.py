"""What a node creates and destroys: a part of `rclpy.node.Node`."""

from __future__ import annotations

import weakref
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.constants import S_TO_NS
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.handles import ContextHandle, Handle
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions, _declare_qos_parameters
from rclpy.readiness import CLIENTS, SERVICES, SUBSCRIPTIONS, Served
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.timer import Rate, Timer
from rclpy.type_support import check_is_valid_msg_type, check_is_valid_srv_type
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from rclpy.clock import Clock
    from rclpy.context import Context
    from rclpy.waitable import Waitable

_E = TypeVar("_E", Publisher, Subscription, Client, Service, Timer, GuardCondition)


class NodeEntities:
    """Publishers, subscriptions, clients, services, timers, guard conditions and waitables."""

    if TYPE_CHECKING:  # of Node

        @property
        def context(self) -> Context: ...
        @property
        def handle(self) -> Handle[runtime.Node]: ...
        def get_clock(self) -> Clock: ...
        def _resolve_name(self, name: str, only_expand: bool = False, *, is_service: bool) -> str: ...

    def _init_entities(self) -> None:
        """There are none yet."""
        self.__publishers: list[Publisher] = []
        self.__subscriptions: list[Subscription] = []
        self.__clients: list[Client] = []
        self.__services: list[Service] = []
        self.__timers: list[Timer] = []
        self.__guards: list[GuardCondition] = []
        self.__waitables: list[Waitable] = []
        self.__served: Served | None = None
        self.__group = MutuallyExclusiveCallbackGroup()
        self.__rate_group = ReentrantCallbackGroup()

    # ---------------------------------------------------------------------------------------------------- what it has

    @property
    def publishers(self) -> Iterator[Publisher]:
        """All that were created with this node, as the following ones."""
        yield from self.__publishers

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        yield from self.__subscriptions

    @property
    def clients(self) -> Iterator[Client]:
        yield from self.__clients

    @property
    def services(self) -> Iterator[Service]:
        yield from self.__services

    @property
    def timers(self) -> Iterator[Timer]:
        yield from self.__timers

    @property
    def guards(self) -> Iterator[GuardCondition]:
        yield from self.__guards

    @property
    def waitables(self) -> Iterator[Waitable]:
        yield from self.__waitables

    def _what_is_served(self) -> Served:
        """For executors."""
        if self.__served is None:
            entities = (self.__timers, self.__subscriptions, self.__guards, self.__clients, self.__services)
            self.__served = Served(self.handle, *entities, self.__waitables)
        return self.__served

    @property
    def default_callback_group(self) -> CallbackGroup:
        """The group of all that is created without one: one callback at a time."""
        return self.__group

    def _validate_qos_or_depth_parameter(self, qos_or_depth: QoSProfile | int) -> QoSProfile:
        if isinstance(qos_or_depth, QoSProfile):
            return qos_or_depth
        if not isinstance(qos_or_depth, int):
            raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
        if qos_or_depth < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=qos_or_depth)

    def __open(self) -> tuple[ContextHandle, runtime.Node]:
        """Raises RCLError after shutdown."""
        handle = self.handle
        if not handle.context.ok():
            raise RCLError("failed to create: the node's context is shut down")
        return handle.context, handle.entity

    def __handle_of(self, entity: Any, kind: int) -> Handle[Any]:
        name = self.handle.logger_name
        handle: Handle[Any] = Handle(self.handle.context, entity, self.handle, logger_name=name, kind=kind)
        if hasattr(entity, "on_ready"):
            handle.set_ready(partial(_asked, entity))
            entity.on_ready(_teller(handle))
        return handle

    def __keep(self, entity: _E, group: CallbackGroup | None, kept: list[_E]) -> _E:
        if group is not None:
            group.add_entity(entity)
        kept.append(entity)
        self._wake_executor()
        return entity

    def _wake_executor(self) -> None:
        self.handle.context.notify()

    def create_publisher(
        self,
        msg_type: type[Any],
        topic: str,
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: PublisherEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        publisher_class: type[Publisher] = Publisher,
    ) -> Publisher:
        """Publish on a topic; `qos_profile` may be a depth.

        Raises:
            InvalidTopicNameException, NoTypeSupportImportedException, UnsupportedEventTypeError: as their names say.
            TypeError, ValueError: `qos_profile` is no profile or depth. RCLError: the context is shut down.
        """
        profile = self._validate_qos_or_depth_parameter(qos_profile)
        group = callback_group or self.default_callback_group
        full = self._resolve_name(topic, is_service=False)
        options = QoSOverridingOptions([]) if qos_overriding_options is None else qos_overriding_options
        _declare_qos_parameters(Publisher, self, full, profile, options)  # type: ignore[arg-type]  # it is a Node
        check_is_valid_msg_type(msg_type)
        callbacks = PublisherEventCallbacks() if event_callbacks is None else event_callbacks
        with self.handle:
            context, node = self.__open()
            queues, told = callbacks._queues(context)
            events = runtime.PublisherEventCallbacks(**told) if told else None
            make = partial(node.create_publisher, msg_type, topic, profile.get_c_qos_profile(), event_callbacks=events)
            handle = self.__with_events(make, queues)
            callbacks._watch(node, handle.entity, handle)
        publisher = publisher_class(
            handle,
            msg_type,
            topic,
            profile,
            event_callbacks=callbacks.create_event_handlers(group, handle, topic),
            callback_group=group,
        )
        for handler in publisher.event_handlers:
            self.add_waitable(handler)
        return self.__keep(publisher, None, self.__publishers)

    def __with_events(self, make: Callable[[], Any], queues: dict[int, deque[Any]]) -> Handle[Any]:
        try:
            with self.handle.context.creating:
                handle = self.__handle_of(make(), SUBSCRIPTIONS)
        except runtime.UnsupportedEventError as error:
            raise UnsupportedEventTypeError(str(error)) from error
        handle.events = queues
        return handle

    def create_subscription(
        self,
        msg_type: type[Any],
        topic: str,
        callback: Callable[..., Any],
        qos_profile: QoSProfile | int,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        raw: bool = False,
    ) -> Subscription:
        """Subscribe to a topic; `qos_profile` may be a depth. The callback gets the message, bytes with `raw`; one of
        two arguments a dict of its times and numbers as well.

        Raises:
            InvalidTopicNameException, NoTypeSupportImportedException, UnsupportedEventTypeError: as their names say.
            TypeError, ValueError: `qos_profile` is no profile or depth. RCLError: the context is shut down.
            RuntimeError: the callback takes neither one argument nor two.
        """
        profile = self._validate_qos_or_depth_parameter(qos_profile)
        group = callback_group or self.default_callback_group
        full = self._resolve_name(topic, is_service=False)
        options = QoSOverridingOptions([]) if qos_overriding_options is None else qos_overriding_options
        _declare_qos_parameters(Subscription, self, full, profile, options)  # type: ignore[arg-type]  # it is a Node
        check_is_valid_msg_type(msg_type)
        callbacks = SubscriptionEventCallbacks() if event_callbacks is None else event_callbacks
        with self.handle:
            context, node = self.__open()
            queues, told = callbacks._queues(context)
            events = runtime.SubscriptionEventCallbacks(**told) if told else None
            qos = profile.get_c_qos_profile()
            make: Callable[[], Any] = partial(
                node.create_subscription, msg_type, topic, None, qos, raw=raw, event_callbacks=events
            )
            handle = self.__with_events(make, queues)
            callbacks._watch(node, handle.entity, handle)
        handlers = callbacks.create_event_handlers(group, handle, topic)
        try:
            made = Subscription(handle, msg_type, topic, callback, group, profile, raw, event_callbacks=handlers)
        except Exception:
            handle.destroy_when_not_in_use()
            raise
        for handler in handlers:
            self.add_waitable(handler)
        return self.__keep(made, group, self.__subscriptions)

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Call a service. Raises InvalidServiceNameException, NoTypeSupportImportedException, RCLError."""
        group = self.default_callback_group if callback_group is None else callback_group
        check_is_valid_srv_type(srv_type)
        self._resolve_name(srv_name, is_service=True)
        with self.handle:
            _, node = self.__open()
            handle = self.__handle_of(node.create_client(srv_type, srv_name, qos_profile.get_c_qos_profile()), CLIENTS)
        made = Client(self.context, handle, srv_type, srv_name, qos_profile, group)
        return self.__keep(made, group, self.__clients)

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Serve: the callback gets the request and an empty response, and answers the response. Raises
        InvalidServiceNameException, NoTypeSupportImportedException, RCLError.
        """
        group = self.default_callback_group if callback_group is None else callback_group
        check_is_valid_srv_type(srv_type)
        self._resolve_name(srv_name, is_service=True)
        with self.handle:
            _, node = self.__open()
            handle = self.__handle_of(
                node.create_service(srv_type, srv_name, None, qos_profile.get_c_qos_profile()), SERVICES
            )
        made = Service(handle, srv_type, srv_name, callback, group, qos_profile)
        return self.__keep(made, group, self.__services)

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Call a function every `timer_period_sec` seconds of the node's clock, or of `clock`; periods that were missed
        are skipped. Without `autostart` it begins with `Timer.reset`.
        """
        period_ns = int(float(timer_period_sec) * S_TO_NS)
        group = self.default_callback_group if callback_group is None else callback_group
        self.__open()
        with self.handle:
            clock = self.get_clock() if clock is None else clock
            timer = Timer(callback, group, period_ns, clock, context=self.context, autostart=autostart)
        return self.__keep(timer, group, self.__timers)

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Call a function after each `GuardCondition.trigger`."""
        group = self.default_callback_group if callback_group is None else callback_group
        self.__open()
        with self.handle:
            guard = GuardCondition(callback, group, context=self.context)
        return self.__keep(guard, group, self.__guards)

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """``rate.sleep()`` keeps a loop at this frequency, in hertz, while an executor spins in another thread.

        Raises ValueError unless the frequency is positive.
        """
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        return Rate(self.create_timer(1.0 / frequency, None, self.__rate_group, clock), context=self.context)

    def add_waitable(self, waitable: Waitable) -> None:
        """Have the executor wait for something of the program's own."""
        self.__waitables.append(waitable)
        self._wake_executor()

    def remove_waitable(self, waitable: Waitable) -> None:
        """Wait for it no more."""
        self.__waitables.remove(waitable)
        self._wake_executor()

    # ------------------------------------------------------------------------------------------------------ destroying

    def __destroy(self, entity: _E, kept: list[_E]) -> bool:
        if entity not in kept:
            return False
        kept.remove(entity)
        for handler in getattr(entity, "event_handlers", ()):
            self.__waitables.remove(handler)
        try:
            entity.destroy()
        except InvalidHandle:
            return False
        self._wake_executor()
        return True

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """End it, after uses under way; False when it is not of this node (any more). So do the following ones."""
        return self.__destroy(publisher, self.__publishers)

    def destroy_subscription(self, subscription: Subscription) -> bool:
        return self.__destroy(subscription, self.__subscriptions)

    def destroy_client(self, client: Client) -> bool:
        return self.__destroy(client, self.__clients)

    def destroy_service(self, service: Service) -> bool:
        return self.__destroy(service, self.__services)

    def destroy_timer(self, timer: Timer) -> bool:
        return self.__destroy(timer, self.__timers)

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        return self.__destroy(guard, self.__guards)

    def destroy_rate(self, rate: Rate) -> bool:
        """End it, and wake all that sleep; False when it is not of this node (any more)."""
        was_there = self.destroy_timer(rate._timer)
        rate.destroy()
        return was_there

    def _destroy_entities(self) -> None:
        for kept in (
            self.__publishers,
            self.__subscriptions,
            self.__clients,
            self.__services,
            self.__timers,
            self.__guards,
        ):
            while kept:
                self.__destroy(kept[0], kept)  # type: ignore[misc]


def _teller(handle: Handle[Any]) -> Callable[[], None]:
    """What an endpoint calls when something arrived; it does not keep the handle."""
    itself = weakref.ref(handle)

    def tell() -> None:
        told = itself()
        if told is not None:
            told.arrived()

    return tell


_asked = attrgetter("is_ready")
