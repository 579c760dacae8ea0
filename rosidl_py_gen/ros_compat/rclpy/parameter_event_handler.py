"""Callbacks for the parameter events of all nodes."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from itertools import chain
from threading import Lock
from typing import Any, Dict, List, Optional, Tuple

from rcl_interfaces.msg import ParameterEvent

from rclpy.callback_groups import CallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_parameter_events
from rclpy.qos_overriding_options import QoSOverridingOptions


@dataclass(eq=False)
class ParameterCallbackHandle:
    """Registration of a callback for one parameter, for `ParameterEventHandler.remove_parameter_callback`."""

    parameter_name: str
    node_name: str
    callback: Callable[[Any], Any]
    mutex: AbstractContextManager[Any] = field(init=False, default_factory=threading.RLock)


@dataclass(eq=False)
class ParameterEventCallbackHandle:
    """Registration of a callback for all events, for `ParameterEventHandler.remove_parameter_event_callback`."""

    callback: Callable[[Any], Any]
    mutex: AbstractContextManager[Any] = field(init=False, default_factory=threading.RLock)


class ParameterEventHandler:
    """Subscription to /parameter_events that calls registered functions, the newest first, with messages."""

    class Callbacks:
        """Registered callbacks of a `ParameterEventHandler`; they may add and remove callbacks."""

        def __init__(self) -> None:
            self.parameter_callbacks: dict[tuple[str, str], list[ParameterCallbackHandle]] = {}
            self.event_callbacks: list[ParameterEventCallbackHandle] = []
            self.mutex = threading.RLock()

        def event_callback(self, event: Any) -> None:
            """Call the callbacks that are registered for an rcl_interfaces/ParameterEvent or its parameters."""
            with self.mutex:
                parameter_handles = [(key, tuple(handles)) for key, handles in self.parameter_callbacks.items()]
                event_handles = tuple(self.event_callbacks)
            for (name, node), handles in parameter_handles:
                parameter = ParameterEventHandler.get_parameter_from_event(event, name, node)
                for handle in handles if parameter is not None else ():
                    with handle.mutex:
                        handle.callback(parameter)
            for event_handle in event_handles:
                with event_handle.mutex:
                    event_handle.callback(event)

        def add_parameter_callback(
            self, parameter_name: str, node_name: str, callback: Callable[[Any], Any]
        ) -> ParameterCallbackHandle:
            handle = ParameterCallbackHandle(parameter_name, node_name, callback)
            with self.mutex:
                self.parameter_callbacks.setdefault((parameter_name, node_name), []).insert(0, handle)
            return handle

        def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
            key = handle.parameter_name, handle.node_name
            with self.mutex:
                handles = self.parameter_callbacks.get(key, [])
                if handle not in handles:
                    raise RuntimeError("Callback doesn't exist")
                handles.remove(handle)
                if not handles:
                    del self.parameter_callbacks[key]

        def add_parameter_event_callback(self, callback: Callable[[Any], Any]) -> ParameterEventCallbackHandle:
            handle = ParameterEventCallbackHandle(callback)
            with self.mutex:
                self.event_callbacks.insert(0, handle)
            return handle

        def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
            with self.mutex:
                if handle not in self.event_callbacks:
                    raise RuntimeError("Callback doesn't exist")
                self.event_callbacks.remove(handle)

    def __init__(
        self,
        node: Node,
        qos_profile: QoSProfile = qos_profile_parameter_events,
        callback_group: CallbackGroup | None = None,
        event_callbacks: SubscriptionEventCallbacks | None = None,
        qos_overriding_options: QoSOverridingOptions | None = None,
        raw: bool = False,
    ) -> None:
        self.node = node
        self.qos_profile = qos_profile
        self._callbacks = ParameterEventHandler.Callbacks()
        self.parameter_event_subscription = node.create_subscription(
            ParameterEvent,
            "/parameter_events",
            self._callbacks.event_callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )

    def destroy(self) -> None:
        self.node.destroy_subscription(self.parameter_event_subscription)

    @staticmethod
    def get_parameter_from_event(event: Any, parameter_name: str, node_name: str) -> Any:
        """Return the new or changed rcl_interfaces/Parameter of a name in an event of a node; None if there is none.

        The argument `node_name` must be fully qualified.
        """
        parameters = ParameterEventHandler.get_parameters_from_event(event) if event.node == node_name else ()
        return next((parameter for parameter in parameters if parameter.name == parameter_name), None)

    @staticmethod
    def get_parameters_from_event(event: Any) -> Iterable[Any]:
        """Yield the new and the changed parameters of an event."""
        yield from chain(event.new_parameters, event.changed_parameters)

    def add_parameter_callback(
        self, parameter_name: str, node_name: str, callback: Callable[[Any], Any]
    ) -> ParameterCallbackHandle:
        """Register a function that is called with each new value of a parameter, as rcl_interfaces/Parameter.

        The node name "" means this node.
        """
        return self._callbacks.add_parameter_callback(parameter_name, self._resolve_path(node_name), callback)

    def remove_parameter_callback(self, handle: ParameterCallbackHandle) -> None:
        """Remove a callback of `add_parameter_callback`; raise RuntimeError if it is not registered."""
        self._callbacks.remove_parameter_callback(handle)

    def add_parameter_event_callback(self, callback: Callable[[Any], Any]) -> ParameterEventCallbackHandle:
        """Register a function that is called with each rcl_interfaces/ParameterEvent of any node."""
        return self._callbacks.add_parameter_event_callback(callback)

    def remove_parameter_event_callback(self, handle: ParameterEventCallbackHandle) -> None:
        """Remove a callback of `add_parameter_event_callback`; raise RuntimeError if it is not registered."""
        self._callbacks.remove_parameter_event_callback(handle)

    def configure_nodes_filter(self, node_names: list[str] | None = None) -> bool:
        """Receive only the events of the given nodes (full names); without names, the events of all nodes."""
        names = [] if node_names is None else node_names
        quoted = [f"'{name}'" for name in names]
        self.parameter_event_subscription.set_content_filter(
            " OR ".join(f"node = %{index}" for index in range(len(names))), quoted
        )
        return self.parameter_event_subscription.is_cft_enabled is bool(names)

    def _resolve_path(self, node_path: str | None = None) -> str:
        if not node_path:
            return str(self.node.get_fully_qualified_name())
        if node_path.startswith("/"):
            return node_path
        return "/" + "/".join(filter(None, (self.node.get_namespace().strip("/"), node_path)))
