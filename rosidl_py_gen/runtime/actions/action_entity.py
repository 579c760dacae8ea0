"""Common parts of action clients and servers: introspection, and the checks of arguments.

All zeros are neither a goal id nor a stamp: on the wire they select every goal (docs/internals/protocol.md 8.4).
"""

from __future__ import annotations

from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, get_args

from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity, user_callback
from rosidl_py_gen.runtime.entities.service_common import ServiceEndpoint
from rosidl_py_gen.runtime.time.values import Time

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.cdr import Action
    from rosidl_py_gen.runtime.actions.types import ActionNames, ActionType
    from rosidl_py_gen.runtime.entities.entity_scope import EntityScope
    from rosidl_py_gen.runtime.entities.introspection import IntrospectionState
    from rosidl_py_gen.runtime.graph.type_hashes import TypeCheck
    from rosidl_py_gen.runtime.loop.user_callback import UserCallback
    from rosidl_py_gen.runtime.time.clock import Clock
    from rosidl_py_gen.runtime.transport.qos import QoSLike

Policy = Literal["parallel", "reject", "preempt", "queue"]
"""Policy of an action server for goals that arrive while another one runs."""

_ID_BYTES = 16
_CANCEL_ALL_HINT = "all zeros select every goal; use cancel_all() for that"


class ActionArgumentError(RosidlError, ValueError):
    """Raised for a value that an action cannot use; the message names the argument."""


def require_depth(name: str, value: int) -> int:
    """Return an integer of at least 1; raises `TypeError`, `ActionArgumentError`."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} must be an int, got {value!r:.100}")
    if value < 1:
        raise ActionArgumentError(f"{name} must be 1 or more, got {value!r}")
    return int(value)


def require_goal_id(goal_id: bytes) -> bytes:
    """Return 16 bytes that are not all zero; raises `TypeError`, `ActionArgumentError`."""
    if not isinstance(goal_id, bytes | bytearray):
        raise TypeError(f"goal_id must be 16 bytes (the attribute bytes of a uuid.UUID), got {goal_id!r:.100}")
    if len(goal_id) != _ID_BYTES:
        raise ActionArgumentError(f"goal_id must be 16 bytes, got {len(goal_id)}: {goal_id.hex()[:64]}")
    if not any(goal_id):
        raise ActionArgumentError(f"goal_id must not be 16 zero bytes: {_CANCEL_ALL_HINT}")
    return bytes(goal_id)


def require_stamp(stamp: Any) -> Time:
    """Return a time that is not zero, from a `Time` or a message; raises `TypeError`, `ActionArgumentError`."""
    if not isinstance(stamp, Time):
        if not all(isinstance(getattr(stamp, name, None), Integral) for name in ("sec", "nanosec")):
            raise TypeError(f"stamp must be a Time or a builtin_interfaces/Time message, got {stamp!r:.100}")
        stamp = Time.from_msg(stamp)
    time: Time = stamp
    if time.nanoseconds == 0:
        raise ActionArgumentError(
            f"stamp must not be zero, which ROS time is before the first /clock: {_CANCEL_ALL_HINT}"
        )
    return time


def server_callbacks(
    scope: EntityScope,
    action: str,
    execute: Callable[[Any], Any] | None,
    goal_callback: Callable[[Any], Any] | None,
    cancel_callback: Callable[[Any], Any] | bool,
    goal_policy: object,
) -> tuple[UserCallback | None, UserCallback | bool]:
    """Return the goal and cancel callbacks of a server; raises `TypeError` or `ValueError` for wrong arguments."""
    if not (isinstance(cancel_callback, bool) or callable(cancel_callback)):
        raise TypeError(
            f"cancel_callback of action {action} must be True, False or a function, got {cancel_callback!r:.100}"
        )
    user_callback(scope, execute, f"execute of action {action}", "the goal")  # a check: `ExecuteFunction` calls it
    on_goal = user_callback(scope, goal_callback, f"goal_callback of action {action}", "the goal message")
    on_cancel: UserCallback | bool = cancel_callback is True
    if not isinstance(cancel_callback, bool):
        on_cancel = user_callback(scope, cancel_callback, f"cancel_callback of action {action}", "the goal") or False
    if goal_callback is not None and execute is None:
        raise TypeError(
            f"goal_callback of action {action} needs execute, else accepted goals are not executed; without execute, "
            "iterate over the server and answer each request: async for request in server"
        )
    if goal_policy not in get_args(Policy):
        raise ValueError(f"goal_policy must be one of {', '.join(get_args(Policy))}, got {goal_policy!r}")
    return on_goal, on_cancel


class ActionEntity(CompositeEntity):
    """Base of action clients and servers, which consist of three services and two topics."""

    def __init__(
        self, scope: EntityScope, action_type: ActionType, names: ActionNames, type_hash_check: TypeCheck | None
    ) -> None:
        super().__init__(scope, type_hash_check=type_hash_check)
        self._type = action_type
        self.name: str = names.action
        """Fully qualified name of the action."""
        self.action_type: str = action_type.ros_name
        """``pkg/action/Name``."""
        self.action_class: type[Action[Any, Any, Any]] = action_type.cls
        """The generated class, with `Goal`, `Result` and `Feedback`."""

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish the requests and responses of all three services on ``<service>/_service_event`` from now on.

        ``ros2 action echo`` of Kilted and later shows them. Arguments and errors as those of a client or service.
        """
        self._require_open()
        for entity in list(self._parts.owned.values()):
            if isinstance(entity, ServiceEndpoint):
                entity.configure_introspection(clock, qos, state)
