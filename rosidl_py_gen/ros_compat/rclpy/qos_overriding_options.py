"""QoS policies that node parameters override when an endpoint is created."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, List, Optional, Text, Type, Union

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult

from rclpy.duration import Duration
from rclpy.exceptions import ParameterAlreadyDeclaredException
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSLivelinessPolicy,
    QoSPolicyEnum,
    QoSPolicyKind,
    QoSProfile,
    QoSReliabilityPolicy,
    ReliabilityPolicy,
)
from rclpy.subscription import Subscription
from rosidl_py_gen.runtime.qos import ENUMS as _ENUMS
from rosidl_py_gen.runtime.qos import PERIODS as _PERIODS
from rosidl_py_gen.runtime.qos import POLICIES as _POLICIES

if TYPE_CHECKING:
    from rclpy.node import BaseNode

QosCallbackResult = SetParametersResult
QosCallbackType = Callable[[QoSProfile], Any]
"""Type of a function that takes a QoS profile and returns a result with `successful` and `reason`."""
QoSProfileAttributes = HistoryPolicy | int | ReliabilityPolicy | DurabilityPolicy | LivelinessPolicy | Duration | bool
"""Type alias for the values of QoS policies."""
_PUBLISHER_POLICIES = tuple(policy.kind for policy in _POLICIES if policy.is_for_publishers)


class InvalidQosOverridesError(Exception):
    """Raised when the program's callback refuses a QoS profile that parameters have changed."""


@dataclass(frozen=True, eq=False)
class QoSOverridingOptions:
    """Selection of QoS policies that parameters of a node can override for an endpoint.

    The parameters are named ``qos_overrides.<topic>.<publisher or subscription>[_<entity_id>].<policy>``.

    Attributes:
        policy_kinds: the policies with a parameter.
        callback: function that accepts or refuses the overridden profile.
        entity_id: suffix that distinguishes endpoints of one topic.
    """

    policy_kinds: Iterable[QoSPolicyKind]
    callback: QosCallbackType | None = field(default=None, kw_only=True)
    entity_id: str | None = field(default=None, kw_only=True)

    @classmethod
    def with_default_policies(
        cls, *, callback: QosCallbackType | None = None, entity_id: str | None = None
    ) -> QoSOverridingOptions:
        """Return options with which parameters can override history, depth and reliability."""
        kinds = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY)
        return cls(kinds, callback=callback, entity_id=entity_id)


def _declare_qos_parameters(
    entity_type: type[Publisher] | type[Subscription],
    node: BaseNode,
    topic_name: str,
    qos: QoSProfile,
    options: QoSOverridingOptions,
) -> None:
    """Declare the QoS parameters of a new endpoint, and change its profile `qos` to their values.

    Raises:
        InvalidQosOverridesError: the callback refuses the profile.
        RuntimeError: a value is unknown.
        ValueError: the profile has an UNKNOWN policy.
    """
    if not issubclass(entity_type, (Publisher, Subscription)):
        raise TypeError("Argument `entity_type` should be a subclass of Publisher or Subscription")
    kind = "publisher" if issubclass(entity_type, Publisher) else "subscription"
    suffix = "" if options.entity_id is None else f"_{options.entity_id}"
    subject = f"for {kind} `{topic_name}` with id `{options.entity_id}`"
    for policy in options.policy_kinds:
        if policy in _PUBLISHER_POLICIES and kind == "subscription":
            continue
        field = policy.name.lower()
        name = f"qos_overrides.{topic_name}.{kind}{suffix}.{field}"
        descriptor = ParameterDescriptor(description=f"{field} {subject}", read_only=True)
        try:
            parameter = node.declare_parameter(name, _get_qos_policy_parameter(qos, policy), descriptor)
        except ParameterAlreadyDeclaredException:
            parameter = node.get_parameter(name)
        setattr(qos, field, _as_policy(field, parameter))
    if options.callback is not None:
        result = options.callback(qos)
        if not result.successful:
            raise InvalidQosOverridesError(f"Provided QoS overrides {subject}, are not valid: {result.reason}")


def _get_qos_policy_parameter(qos: QoSProfile, policy: QoSPolicyKind) -> str | int | bool:
    value = getattr(qos, policy.name.lower())
    if isinstance(value, QoSPolicyEnum):
        if value.name == "UNKNOWN":
            raise ValueError("User provided QoS profile is invalid")
        return value.name.lower()
    number: int = value.nanoseconds if isinstance(value, Duration) else value
    return number


def _as_policy(field: str, parameter: Parameter) -> Any:
    value = parameter.value
    if field in _ENUMS:
        try:
            return _ENUMS[field][value.upper()]
        except KeyError:
            raise RuntimeError(f"Unexpected QoS override for policy `{field}`: `{value}`") from None
    return Duration(nanoseconds=value) if field in _PERIODS.values() else value
