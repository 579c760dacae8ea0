"""Mixin of `rclpy.node.Node` that creates and destroys entities."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy._rclpy_pybind11 import RCLError
from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.constants import S_TO_NS
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.handles import ContextHandle, Handle, denied_as_rcl_error
from rclpy.impl._fields import value_or_default
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.qos_overriding_options import QoSOverridingOptions, _declare_qos_parameters
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
_KINDS = ("publishers", "subscriptions", "clients", "services", "timers", "guards")


class NodeEntities:
    """Publishers, subscriptions, clients, services, timers, guard conditions and waitables of a node."""

    if TYPE_CHECKING:  # of Node

        @property
        def context(self) -> Context: ...
        @property
        def handle(self) -> Handle[runtime.Node]: ...
        def _rosidl_own_clock(self) -> Clock: ...
        def _rosidl_resolve_name(self, name: str, only_expand: bool = False, *, is_service: bool) -> str: ...

    def _rosidl_init_entities(self) -> None:
        # Some programs read rclpy's private attributes (`_timers`), others store values of other types in them. So each
        # list is stored twice; the code here uses `_rosidl_entity_lists`.
        self._rosidl_entity_lists: dict[str, list[Any]] = {kind: [] for kind in (*_KINDS, "waitables")}
        self._rosidl_group: CallbackGroup = MutuallyExclusiveCallbackGroup()
        self._rosidl_rate_group: CallbackGroup = ReentrantCallbackGroup()
        for kind in _KINDS:
            setattr(self, f"_{kind}", self._rosidl_entity_lists[kind])
        self._default_callback_group, self._rate_group = self._rosidl_group, self._rosidl_rate_group

    @property
    def publishers(self) -> Iterator[Publisher]:
        """Publishers of the node; the properties below are analogous."""
        yield from self._rosidl_entity_lists["publishers"]

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        yield from self._rosidl_entity_lists["subscriptions"]

    @property
    def clients(self) -> Iterator[Client]:
        yield from self._rosidl_entity_lists["clients"]

    @property
    def services(self) -> Iterator[Service]:
        yield from self._rosidl_entity_lists["services"]

    @property
    def timers(self) -> Iterator[Timer]:
        yield from self._rosidl_entity_lists["timers"]

    @property
    def guards(self) -> Iterator[GuardCondition]:
        yield from self._rosidl_entity_lists["guards"]

    @property
    def waitables(self) -> Iterator[Waitable]:
        yield from self._rosidl_entity_lists["waitables"]

    @property
    def default_callback_group(self) -> CallbackGroup:
        """Group of the entities that are created without a group: it runs one callback at a time."""
        return value_or_default(self._default_callback_group, CallbackGroup, self._rosidl_group)

    @staticmethod
    def _rosidl_to_profile(qos_or_depth: QoSProfile | int) -> QoSProfile:
        if isinstance(qos_or_depth, QoSProfile):
            return qos_or_depth
        if not isinstance(qos_or_depth, int):
            raise TypeError(f"Expected QoSProfile or int, but received {type(qos_or_depth)!r}")
        if qos_or_depth < 0:
            raise ValueError("history depth must be greater than or equal to zero")
        return QoSProfile(depth=qos_or_depth)

    _validate_qos_or_depth_parameter = _rosidl_to_profile

    def _rosidl_require_ok(self) -> tuple[ContextHandle, runtime.Node]:
        handle = self.handle
        if not handle.context.ok():
            raise RCLError("failed to create an entity: the node's context is shut down")
        return handle.context, handle.entity

    def _rosidl_register(self, entity: _E, group: CallbackGroup | None, kind: str) -> _E:
        if group is not None:
            group.add_entity(entity)
        for entities in self._rosidl_lists_of_kind(kind):
            entities.append(entity)
        self._rosidl_entity_lists["waitables"] += getattr(entity, "event_handlers", ())
        self._rosidl_wake_executor()
        return entity

    def _rosidl_lists_of_kind(self, kind: str) -> list[list[Any]]:
        """Return the list of entities, and the list that the program has stored in rclpy's attribute instead."""
        own_list, program_list = self._rosidl_entity_lists[kind], getattr(self, f"_{kind}", None)
        if isinstance(program_list, list) and program_list is not own_list:
            return [own_list, program_list]
        return [own_list]

    def _rosidl_wake_executor(self) -> None:
        self.handle.context.notify()

    _wake_executor = _rosidl_wake_executor

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
        """Create a publisher; `qos_profile` may be a depth.

        Raises:
            InvalidTopicNameException, NoTypeSupportImportedException, UnsupportedEventTypeError: see the classes.
            TypeError, ValueError: `qos_profile` is not a profile or depth.
            RCLError: the context is shut down.
        """
        profile = self._rosidl_to_profile(qos_profile)
        group = callback_group or self.default_callback_group
        callbacks = PublisherEventCallbacks() if event_callbacks is None else event_callbacks
        create = partial(self.handle.entity.create_publisher, msg_type, topic)
        handle = self._rosidl_create_on_topic(
            Publisher, msg_type, topic, profile, qos_overriding_options, callbacks, create
        )
        publisher = publisher_class(
            handle,
            msg_type,
            topic,
            profile,
            event_callbacks=callbacks.create_event_handlers(group, handle, topic),
            callback_group=group,
        )
        return self._rosidl_register(publisher, None, "publishers")

    def _rosidl_create_on_topic(
        self,
        entity_class: type[Publisher] | type[Subscription],
        msg_type: type[Any],
        topic: str,
        profile: QoSProfile,
        options: QoSOverridingOptions | None,
        callbacks: PublisherEventCallbacks | SubscriptionEventCallbacks,
        create: Callable[..., Any],
    ) -> Handle[Any]:
        """Check the arguments, override the profile, and return the handle of the endpoint that `create` returns."""
        full = self._rosidl_resolve_name(topic, is_service=False)
        options = QoSOverridingOptions([]) if options is None else options
        _declare_qos_parameters(entity_class, self, full, profile, options)  # type: ignore[arg-type]  # it is a Node
        check_is_valid_msg_type(msg_type)
        with self.handle:
            context, node = self._rosidl_require_ok()
            queues, runtime_callbacks = callbacks._rosidl_queues(context)
            try:
                with context.creation_lock, denied_as_rcl_error():
                    endpoint = create(qos=profile.get_c_qos_profile(), event_callbacks=runtime_callbacks)
                    handle = self.handle.create_endpoint_handle(endpoint, "subscriptions")
            except runtime.UnsupportedEventError as error:
                raise UnsupportedEventTypeError(str(error)) from error
            handle.events = queues
            callbacks._rosidl_watch(node, handle.entity, handle)
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
        """Create a subscription; `qos_profile` may be a depth.

        The callback is called with the message (bytes if `raw`), and with a dict of times and sequence numbers if it
        takes two arguments.

        Raises:
            InvalidTopicNameException, NoTypeSupportImportedException, UnsupportedEventTypeError: see the classes.
            TypeError, ValueError: `qos_profile` is not a profile or depth.
            RCLError: the context is shut down.
            RuntimeError: the callback does not take one or two arguments.
        """
        profile = self._rosidl_to_profile(qos_profile)
        group = callback_group or self.default_callback_group
        callbacks = SubscriptionEventCallbacks() if event_callbacks is None else event_callbacks
        create: Callable[..., Any] = partial(self.handle.entity.create_subscription, msg_type, topic, raw=raw)
        handle = self._rosidl_create_on_topic(
            Subscription, msg_type, topic, profile, qos_overriding_options, callbacks, create
        )
        handlers = callbacks.create_event_handlers(group, handle, topic)
        try:
            subscription = Subscription(
                handle, msg_type, topic, callback, group, profile, raw, event_callbacks=handlers
            )
        except Exception:
            handle.destroy_when_not_in_use()
            raise
        return self._rosidl_register(subscription, group, "subscriptions")

    def create_client(
        self,
        srv_type: Any,
        srv_name: str,
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Client:
        """Create a client; raise InvalidServiceNameException, NoTypeSupportImportedException or RCLError."""
        group = self.default_callback_group if callback_group is None else callback_group
        handle = self._rosidl_create_on_service("client", srv_type, srv_name, qos_profile)
        client = Client(self.context, handle, srv_type, srv_name, qos_profile, group)
        return self._rosidl_register(client, group, "clients")

    def create_service(
        self,
        srv_type: Any,
        srv_name: str,
        callback: Callable[[Any, Any], Any],
        *,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> Service:
        """Create a service whose callback takes a request and an empty response, and returns the response.

        Raises:
            InvalidServiceNameException, NoTypeSupportImportedException, RCLError: see the classes.
        """
        group = self.default_callback_group if callback_group is None else callback_group
        handle = self._rosidl_create_on_service("service", srv_type, srv_name, qos_profile)
        service = Service(handle, srv_type, srv_name, callback, group, qos_profile)
        return self._rosidl_register(service, group, "services")

    def _rosidl_create_on_service(self, role: str, srv_type: Any, srv_name: str, profile: QoSProfile) -> Handle[Any]:
        """Check the arguments, and return the handle of a new ``client`` or ``service``."""
        check_is_valid_srv_type(srv_type)
        self._rosidl_resolve_name(srv_name, is_service=True)
        with self.handle, denied_as_rcl_error():
            _, node = self._rosidl_require_ok()
            create = node.create_client if role == "client" else node.create_service
            return self.handle.create_endpoint_handle(
                create(srv_type, srv_name, qos=profile.get_c_qos_profile()), f"{role}s"
            )

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[[], Any] | None,
        callback_group: CallbackGroup | None = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Timer:
        """Call a function every `timer_period_sec` seconds of the node's clock, or of `clock`.

        Missed periods are skipped. Without `autostart`, the timer starts with `Timer.reset`.
        """
        period_ns = int(float(timer_period_sec) * S_TO_NS)
        group = self.default_callback_group if callback_group is None else callback_group
        self._rosidl_require_ok()
        with self.handle:
            clock = self._rosidl_own_clock() if clock is None else clock
            timer = Timer(callback, group, period_ns, clock, context=self.context, autostart=autostart)
        return self._rosidl_register(timer, group, "timers")

    def create_guard_condition(
        self, callback: Callable[[], Any], callback_group: CallbackGroup | None = None
    ) -> GuardCondition:
        """Create a guard condition: its callback is called after `GuardCondition.trigger`."""
        group = self.default_callback_group if callback_group is None else callback_group
        self._rosidl_require_ok()
        with self.handle:
            guard = GuardCondition(callback, group, context=self.context)
        return self._rosidl_register(guard, group, "guards")

    def create_rate(self, frequency: float, clock: Clock | None = None) -> Rate:
        """Create a rate, whose ``sleep`` keeps a loop at a frequency in hertz while another thread spins the node.

        Raises:
            ValueError: the frequency is not positive.
        """
        if frequency <= 0:
            raise ValueError("frequency must be > 0")
        group = value_or_default(self._rate_group, CallbackGroup, self._rosidl_rate_group)
        return Rate(self.create_timer(1.0 / frequency, None, group, clock), context=self.context)

    def add_waitable(self, waitable: Waitable) -> None:
        """Make the executor wait for an object of the program."""
        self._rosidl_entity_lists["waitables"].append(waitable)
        self._rosidl_wake_executor()

    def remove_waitable(self, waitable: Waitable) -> None:
        """Undo `add_waitable`."""
        self._rosidl_entity_lists["waitables"].remove(waitable)
        self._rosidl_wake_executor()

    def _rosidl_destroy(self, entity: Any, kind: str) -> bool:
        own_list, *other_lists = self._rosidl_lists_of_kind(kind)
        if entity not in own_list:
            return False
        for entities in (own_list, *other_lists):
            if entity in entities:
                entities.remove(entity)
        for handler in getattr(entity, "event_handlers", ()):
            self._rosidl_entity_lists["waitables"].remove(handler)
        try:
            entity.destroy()
        except InvalidHandle:
            return False
        self._rosidl_wake_executor()
        return True

    def destroy_publisher(self, publisher: Publisher) -> bool:
        """Destroy an entity after its current uses; return False if it is not, or no longer, of this node."""
        return self._rosidl_destroy(publisher, "publishers")

    def destroy_subscription(self, subscription: Subscription) -> bool:
        return self._rosidl_destroy(subscription, "subscriptions")

    def destroy_client(self, client: Client) -> bool:
        return self._rosidl_destroy(client, "clients")

    def destroy_service(self, service: Service) -> bool:
        return self._rosidl_destroy(service, "services")

    def destroy_timer(self, timer: Timer) -> bool:
        return self._rosidl_destroy(timer, "timers")

    def destroy_guard_condition(self, guard: GuardCondition) -> bool:
        return self._rosidl_destroy(guard, "guards")

    def destroy_rate(self, rate: Rate) -> bool:
        """Destroy a rate and wake up its sleeping threads; return False if it is not of this node."""
        was_destroyed = self.destroy_timer(rate._timer)
        rate.destroy()
        return was_destroyed

    def _rosidl_destroy_entities(self) -> None:
        for kind in _KINDS:
            while entities := self._rosidl_lists_of_kind(kind)[0]:
                self._rosidl_destroy(entities[0], kind)
