"""What is known of one publisher or subscription of a topic."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

from rclpy.qos import QoSHistoryPolicy, QoSPresetProfiles, QoSProfile
from rclpy.type_hash import TypeHash
from rosidl_py_gen import runtime


class TopicEndpointTypeEnum(IntEnum):
    """What it is."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2


class TopicEndpointInfo:
    """One publisher or subscription; fields are keywords of the constructor and can be set, of the right type only:
    AssertionError otherwise.
    """

    __slots__ = (
        "_endpoint_gid",
        "_endpoint_type",
        "_node_name",
        "_node_namespace",
        "_qos_profile",
        "_topic_type",
        "_topic_type_hash",
    )

    _node_name: str
    _node_namespace: str
    _topic_type: str

    def __init__(self, **kwargs: Any) -> None:
        if not all(f"_{key}" in self.__slots__ for key in kwargs):
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        self.node_name = kwargs.get("node_name", "")
        self.node_namespace = kwargs.get("node_namespace", "")
        self.topic_type = kwargs.get("topic_type", "")
        self.topic_type_hash = kwargs.get("topic_type_hash", TypeHash())
        self.endpoint_type = kwargs.get("endpoint_type", TopicEndpointTypeEnum.INVALID)
        self.endpoint_gid = kwargs.get("endpoint_gid", [])
        self.qos_profile = kwargs.get("qos_profile", QoSPresetProfiles.UNKNOWN.value)

    @classmethod
    def _from_runtime(cls, info: runtime.TopicEndpointInfo) -> TopicEndpointInfo:
        known = info.topic_type_hash.startswith("RIHS01_")
        return cls(
            node_name=info.node_name,
            node_namespace=info.node_namespace,
            topic_type=info.topic_type,
            topic_type_hash=TypeHash(1, bytes.fromhex(info.topic_type_hash[7:])) if known else TypeHash(),
            endpoint_type=int(info.endpoint_type),
            endpoint_gid=list(info.endpoint_gid),
            qos_profile=QoSProfile._from_runtime(info.qos_profile),
        )

    @property
    def node_name(self) -> str:
        """Of the node that has it."""
        return self._node_name

    @node_name.setter
    def node_name(self, value: str) -> None:
        self._node_name = _checked("node_name", value, str)

    @property
    def node_namespace(self) -> str:
        """Of the node that has it."""
        return self._node_namespace

    @node_namespace.setter
    def node_namespace(self, value: str) -> None:
        self._node_namespace = _checked("node_namespace", value, str)

    @property
    def topic_type(self) -> str:
        """``pkg/msg/Name``."""
        return self._topic_type

    @topic_type.setter
    def topic_type(self, value: str) -> None:
        self._topic_type = _checked("topic_type", value, str)

    @property
    def topic_type_hash(self) -> TypeHash:
        """As it announces it."""
        return self._topic_type_hash

    @topic_type_hash.setter
    def topic_type_hash(self, value: TypeHash | dict[str, Any]) -> None:
        self._topic_type_hash = (
            TypeHash(**value) if isinstance(value, dict) else _checked("topic_type_hash", value, TypeHash)
        )

    @property
    def endpoint_type(self) -> TopicEndpointTypeEnum:
        """Publisher or subscription."""
        return self._endpoint_type

    @endpoint_type.setter
    def endpoint_type(self, value: TopicEndpointTypeEnum | int) -> None:
        self._endpoint_type = TopicEndpointTypeEnum(_checked("endpoint_type", value, int))

    @property
    def endpoint_gid(self) -> list[int]:
        """The bytes that identify it."""
        return self._endpoint_gid

    @endpoint_gid.setter
    def endpoint_gid(self, value: list[int]) -> None:
        for number in value:
            _checked("endpoint_gid", number, int)
        self._endpoint_gid = value

    @property
    def qos_profile(self) -> QoSProfile:
        """Its quality of service."""
        return self._qos_profile

    @qos_profile.setter
    def qos_profile(self, value: QoSProfile | dict[str, Any]) -> None:
        self._qos_profile = (
            QoSProfile(**value) if isinstance(value, dict) else _checked("qos_profile", value, QoSProfile)
        )

    __hash__ = None  # type: ignore[assignment]  # as in rclpy

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


def _checked(name: str, value: Any, kind: type) -> Any:
    if not isinstance(value, kind):
        raise AssertionError(f"{name} must be {kind.__name__}, got {value!r:.100}")
    return value
