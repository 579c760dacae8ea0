"""Information about a publisher or subscription of a topic."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, TypeVar

from rclpy.impl._fields import Checked
from rclpy.qos import QoSHistoryPolicy, QoSPresetProfiles, QoSProfile
from rclpy.type_hash import TypeHash
from rosidl_py_gen import runtime

if TYPE_CHECKING:
    from collections.abc import Callable

_T = TypeVar("_T")


class TopicEndpointTypeEnum(IntEnum):
    """Direction of an endpoint."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


def _require_ints(numbers: Any) -> list[int]:
    for number in numbers:
        if not isinstance(number, int):
            raise AssertionError(f"endpoint_gid must be int, got {number!r:.100}")
    return list(numbers)


def _from_dict(cls: type[_T]) -> Callable[[Any], _T]:
    return lambda value: cls(**value) if isinstance(value, dict) else value


_DEFAULTS: dict[str, Any] = {
    "node_name": "",
    "node_namespace": "",
    "topic_type": "",
    "topic_type_hash": {},
    "endpoint_type": TopicEndpointTypeEnum.INVALID,
    "endpoint_gid": [],
    "qos_profile": QoSPresetProfiles.UNKNOWN.value,
}


class TopicEndpointInfo:
    """Publisher or subscription of a topic; the fields are keywords of the constructor and can be set.

    Attributes:
        node_name: name of its node.
        node_namespace: namespace of its node.
        topic_type: type, ``pkg/msg/Name``.
        topic_type_hash: announced hash; a dict has the arguments of `TypeHash`.
        endpoint_type: publisher or subscription.
        endpoint_gid: bytes that identify the endpoint.
        qos_profile: QoS profile; a dict has the arguments of `QoSProfile`.

    Raises:
        AssertionError: a field is unknown, or a value has the wrong type.
    """

    __slots__ = tuple(f"_{name}" for name in _DEFAULTS)

    node_name = Checked[str](str)
    node_namespace = Checked[str](str)
    topic_type = Checked[str](str)
    topic_type_hash = Checked[TypeHash](TypeHash, dict, convert=_from_dict(TypeHash))
    endpoint_type = Checked[TopicEndpointTypeEnum](int, convert=TopicEndpointTypeEnum)
    endpoint_gid = Checked[list[int]](object, convert=_require_ints)
    qos_profile = Checked[QoSProfile](QoSProfile, dict, convert=_from_dict(QoSProfile))

    def __init__(self, **kwargs: Any) -> None:
        if not kwargs.keys() <= _DEFAULTS.keys():
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        for name, default in _DEFAULTS.items():
            setattr(self, name, kwargs.get(name, default))

    @classmethod
    def _rosidl_from_runtime(cls, info: runtime.TopicEndpointInfo) -> TopicEndpointInfo:
        has_hash = info.topic_type_hash.startswith("RIHS01_")
        return cls(
            node_name=info.node_name,
            node_namespace=info.node_namespace,
            topic_type=info.topic_type,
            topic_type_hash=TypeHash(1, bytes.fromhex(info.topic_type_hash[7:])) if has_hash else TypeHash(),
            endpoint_type=int(info.endpoint_type),
            endpoint_gid=list(info.endpoint_gid),
            qos_profile=QoSProfile._rosidl_from_runtime(info.qos_profile),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TopicEndpointInfo):
            return False
        return all(getattr(self, slot) == getattr(other, slot) for slot in self.__slots__)

    def __str__(self) -> str:
        qos = self.qos_profile
        depth = f" ({qos.depth})" if qos.history == QoSHistoryPolicy.KEEP_LAST else ""
        return "\n".join(
            [
                f"Node name: {self.node_name}",
                f"Node namespace: {self.node_namespace}",
                f"Topic type: {self.topic_type}",
                f"Topic type hash: {self.topic_type_hash}",
                f"Endpoint type: {self.endpoint_type.name}",
                f"GID: {'.'.join(format(number, '02x') for number in self.endpoint_gid)}",
                "QoS profile:",
                f"  Reliability: {qos.reliability.name}",
                f"  History (Depth): {qos.history.name}{depth}",
                f"  Durability: {qos.durability.name}",
                f"  Lifespan: {qos.lifespan}",
                f"  Deadline: {qos.deadline}",
                f"  Liveliness: {qos.liveliness.name}",
                f"  Liveliness lease duration: {qos.liveliness_lease_duration}",
            ]
        )
