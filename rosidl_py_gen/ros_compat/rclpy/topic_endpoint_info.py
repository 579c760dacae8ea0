"""What is known of one publisher or subscription of a topic."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from rclpy.impl._fields import Checked
from rclpy.qos import QoSHistoryPolicy, QoSPresetProfiles, QoSProfile
from rclpy.type_hash import TypeHash
from rosidl_py_gen import runtime


class TopicEndpointTypeEnum(IntEnum):
    """What it is."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


def _ints(numbers: Any) -> list[int]:
    for number in numbers:
        if not isinstance(number, int):
            raise AssertionError(f"endpoint_gid must be int, got {number!r:.100}")
    return list(numbers)


def _type_hash(given: TypeHash | dict[str, Any]) -> TypeHash:
    return TypeHash(**given) if isinstance(given, dict) else given


def _qos_profile(given: QoSProfile | dict[str, Any]) -> QoSProfile:
    return QoSProfile(**given) if isinstance(given, dict) else given


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
    """One publisher or subscription; fields are keywords of the constructor and can be set, of the right type only:
    AssertionError otherwise.

    Attributes:
        node_name: of the node that has it.
        node_namespace: of that node.
        topic_type: ``pkg/msg/Name``.
        topic_type_hash: as it announces it; a dict is taken for the arguments of one.
        endpoint_type: publisher or subscription.
        endpoint_gid: the bytes that identify it.
        qos_profile: its quality of service; a dict is taken for the arguments of a `QoSProfile`.
    """

    __slots__ = tuple(f"_{name}" for name in _DEFAULTS)

    node_name = Checked[str](str)
    node_namespace = Checked[str](str)
    topic_type = Checked[str](str)
    topic_type_hash = Checked[TypeHash](TypeHash, dict, made=_type_hash)
    endpoint_type = Checked[TopicEndpointTypeEnum](int, made=TopicEndpointTypeEnum)
    endpoint_gid = Checked[list[int]](object, made=_ints)
    qos_profile = Checked[QoSProfile](QoSProfile, dict, made=_qos_profile)

    def __init__(self, **kwargs: Any) -> None:
        if not kwargs.keys() <= _DEFAULTS.keys():
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        for name, default in _DEFAULTS.items():
            setattr(self, name, kwargs.get(name, default))

    @classmethod
    def _rosidl_from_runtime(cls, info: runtime.TopicEndpointInfo) -> TopicEndpointInfo:
        known = info.topic_type_hash.startswith("RIHS01_")
        return cls(
            node_name=info.node_name,
            node_namespace=info.node_namespace,
            topic_type=info.topic_type,
            topic_type_hash=TypeHash(1, bytes.fromhex(info.topic_type_hash[7:])) if known else TypeHash(),
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
