"""Common parts of action clients and servers: introspection, and the checks of arguments.

All zeros are neither a goal id nor a stamp: on the wire they select every goal (docs/internals/protocol.md 8.4).
"""

from __future__ import annotations

from numbers import Integral
from typing import TYPE_CHECKING, Any, Literal, get_args

from rosidl_py_gen.base.signatures import require_signature
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.runtime.entities.entity_scope import CompositeEntity
from rosidl_py_gen.runtime.entities.service_common import ServiceEndpoint
from rosidl_py_gen.runtime.loop.user_functions import require_callable
from rosidl_py_gen.runtime.time.values import Time

if TYPE_CHECKING:
    from rosidl_py_gen.runtime.entities.introspection import IntrospectionState
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


def require_server_options(
    action: str, execute: object, goal_callback: object, cancel_callback: object, goal_policy: object
) -> None:
    """Raise `TypeError` or `ValueError` for wrong arguments, before anything is created."""
    if not (isinstance(cancel_callback, bool) or callable(cancel_callback)):
        raise TypeError(
            f"cancel_callback of action {action} must be True, False or a function, got {cancel_callback!r:.100}"
        )
    for callback, name, argument in (
        (execute, "execute", "the goal"),
        (goal_callback, "goal_callback", "the goal message"),
        (None if isinstance(cancel_callback, bool) else cancel_callback, "cancel_callback", "the goal"),
    ):
        subject = f"{name} of action {action}"
        require_callable(callback, subject)
        if callable(callback):
            require_signature(callback, subject, argument)
    if goal_callback is not None and execute is None:
        raise TypeError(
            f"goal_callback of action {action} needs execute, else accepted goals are not executed; without execute, "
            "iterate over the server and answer each request: async for request in server"
        )
    if goal_policy not in get_args(Policy):
        raise ValueError(f"goal_policy must be one of {', '.join(get_args(Policy))}, got {goal_policy!r}")


class ActionEntity(CompositeEntity):
    """Base of action clients and servers, which consist of three services and two topics."""

    name: str

    def configure_introspection(self, clock: Clock, qos: QoSLike, state: IntrospectionState) -> None:
        """Publish the requests and responses of all three services on ``<service>/_service_event`` from now on.

        ``ros2 action echo`` of Kilted and later shows them. Arguments and errors as those of a client or service.
        """
        self._require_open()
        for entity in list(self._parts.owned.values()):
            if isinstance(entity, ServiceEndpoint):
                entity.configure_introspection(clock, qos, state)
