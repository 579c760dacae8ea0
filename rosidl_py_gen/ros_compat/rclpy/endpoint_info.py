"""Information about the endpoints of a topic or service; a module of rclpy 10."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, TypeVar, cast

from rclpy._classes import Checked
from rclpy.qos import QoSHistoryPolicy, QoSPresetProfiles, QoSProfile
from rclpy.type_hash import TypeHash
from rosidl_py_gen import runtime
from rosidl_py_gen.runtime.qos import POLICIES as _POLICIES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.type_hash import TypeHashDictionary
    from rosidl_py_gen.runtime._rclpy_support import ServiceEndpoints

_T = TypeVar("_T")


class EndpointTypeEnum(IntEnum):
    """Kind of an endpoint: publisher, subscription, client or server."""

    INVALID = 0
    PUBLISHER = 1
    SUBSCRIPTION = 2
    CLIENT = 3
    SERVER = 4


def _require_ints(numbers: Any) -> list[int]:
    for number in numbers:
        if not isinstance(number, int):
            raise AssertionError(f"endpoint_gid must be int, got {number!r:.100}")
    return list(numbers)


def _require_lists_of_ints(gids: list[Any]) -> list[list[int]]:
    for gid in gids:
        if not isinstance(gid, list):
            raise AssertionError(f"endpoint_gids must be lists of int, got {gid!r:.100}")
    return [_require_ints(gid) for gid in gids]


def _require_profiles(profiles: list[Any]) -> list[QoSProfile]:
    for profile in profiles:
        if not isinstance(profile, (QoSProfile, dict)):
            raise AssertionError(f"qos_profiles must be QoSProfile or dict, got {profile!r:.100}")
    return [_from_dict(QoSProfile)(profile) for profile in profiles]


def _hash_of(text: str) -> TypeHash:
    """Return the `TypeHash` for a RIHS01 text; the invalid hash for an empty text."""
    return TypeHash(1, bytes.fromhex(text[7:])) if text.startswith("RIHS01_") else TypeHash()


def _gid_text(gid: list[int]) -> str:
    return ".".join(format(number, "02x") for number in gid)


def _profile_lines(qos: QoSProfile, indent: str, history: str) -> list[str]:
    values = {policy: getattr(qos, policy.rmw_name) for policy in _POLICIES if policy.label}
    texts = {policy: value.name if policy.enum is not None else value for policy, value in values.items()}
    return [
        f"{indent}{policy.label}: {history if policy.rmw_name == 'history' else text}" for policy, text in texts.items()
    ]


def _from_dict(cls: type[_T]) -> Callable[[Any], _T]:
    return lambda value: cls(**value) if isinstance(value, dict) else value


_DEFAULTS: dict[str, Any] = {
    "node_name": "",
    "node_namespace": "",
    "topic_type": "",
    "topic_type_hash": {},
    "endpoint_type": EndpointTypeEnum.INVALID,
    "endpoint_gid": [],
    "qos_profile": QoSPresetProfiles.UNKNOWN.value,
}


class TopicEndpointInfo:
    """Publisher or subscription of a topic; the fields are keywords of the constructor and can be set.

    Attributes:
        node_name: name of the endpoint's node.
        node_namespace: namespace of the endpoint's node.
        topic_type: message type, ``pkg/msg/Name``.
        topic_type_hash: announced type hash; a dict has the arguments of `TypeHash`.
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
    endpoint_type = Checked[EndpointTypeEnum](int, convert=EndpointTypeEnum)
    endpoint_gid = Checked[list[int]](object, convert=_require_ints)
    qos_profile = Checked[QoSProfile](QoSProfile, dict, convert=_from_dict(QoSProfile))

    def __init__(self, **kwargs: Any) -> None:
        if not kwargs.keys() <= _DEFAULTS.keys():
            raise AssertionError(f"Invalid arguments passed to constructor: {kwargs.keys()!r}")
        for name, default in _DEFAULTS.items():
            setattr(self, name, kwargs.get(name, default))

    @classmethod
    def rosidl_from_runtime(cls, info: runtime.TopicEndpointInfo) -> TopicEndpointInfo:
        return cls(
            node_name=info.node_name,
            node_namespace=info.node_namespace,
            topic_type=info.topic_type,
            topic_type_hash=_hash_of(info.topic_type_hash),
            endpoint_type=int(info.endpoint_type),
            endpoint_gid=list(info.endpoint_gid),
            qos_profile=QoSProfile.rosidl_from_runtime(info.qos_profile),
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
                f"GID: {_gid_text(self.endpoint_gid)}",
                "QoS profile:",
                *_profile_lines(qos, "  ", f"{qos.history.name}{depth}"),
            ]
        )


class ServiceEndpointInfo:
    """Client or server of a service; the fields are parameters of the constructor and can be set.

    On DDS, a client or server has two endpoints: first a reader, then a writer.

    Attributes:
        node_name: name of the node of the client or server.
        node_namespace: namespace of the node.
        service_type: service type, ``pkg/srv/Name``.
        service_type_hash: announced type hash; a dict has the arguments of `TypeHash`.
        qos_profiles: QoS profile of each endpoint; a dict has the arguments of `QoSProfile`.
        endpoint_gids: bytes that identify each endpoint.
        endpoint_type: client or server.
        endpoint_count: number of endpoints.

    Raises:
        AssertionError: a value has the wrong type.
    """

    __slots__ = (
        "_endpoint_count",
        "_endpoint_gids",
        "_endpoint_type",
        "_node_name",
        "_node_namespace",
        "_qos_profiles",
        "_service_type",
        "_service_type_hash",
    )

    node_name = Checked[str](str)
    node_namespace = Checked[str](str)
    service_type = Checked[str](str)
    service_type_hash = Checked[TypeHash](TypeHash, dict, convert=_from_dict(TypeHash))
    qos_profiles = Checked[list[QoSProfile]](list, convert=_require_profiles)
    endpoint_gids = Checked[list[list[int]]](list, convert=_require_lists_of_ints)
    endpoint_type = Checked[EndpointTypeEnum](int, convert=EndpointTypeEnum)
    endpoint_count = Checked[int](int)

    def __init__(
        self,
        node_name: str = "",
        node_namespace: str = "",
        service_type: str = "",
        service_type_hash: TypeHash | TypeHashDictionary | None = None,
        qos_profiles: Sequence[QoSProfile | dict[str, Any]] = (),
        endpoint_gids: Sequence[list[int]] = (),
        endpoint_type: EndpointTypeEnum | int = EndpointTypeEnum.INVALID,
        endpoint_count: int = 0,
    ) -> None:
        self.node_name = node_name
        self.node_namespace = node_namespace
        self.service_type = service_type
        self.service_type_hash = TypeHash() if service_type_hash is None else cast("TypeHash", service_type_hash)
        self.qos_profiles = cast("list[QoSProfile]", [] if qos_profiles == () else qos_profiles)
        self.endpoint_gids = cast("list[list[int]]", [] if endpoint_gids == () else endpoint_gids)
        self.endpoint_type = cast("EndpointTypeEnum", endpoint_type)
        self.endpoint_count = endpoint_count

    @classmethod
    def rosidl_from_runtime(cls, info: ServiceEndpoints, endpoint_type: EndpointTypeEnum) -> ServiceEndpointInfo:
        return cls(
            node_name=info.node_name,
            node_namespace=info.node_namespace,
            service_type=info.service_type,
            service_type_hash=_hash_of(info.service_type_hash),
            qos_profiles=[QoSProfile.rosidl_from_runtime(profile) for profile in info.qos_profiles],
            endpoint_gids=[list(gid) for gid in info.gids],
            endpoint_type=endpoint_type,
            endpoint_count=len(info.gids),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ServiceEndpointInfo):
            return False
        return all(getattr(self, slot) == getattr(other, slot) for slot in self.__slots__)

    def __str__(self) -> str:
        lines = [
            f"Node name: {self.node_name}",
            f"Node namespace: {self.node_namespace}",
            f"Service type: {self.service_type}",
            f"Service type hash: {self.service_type_hash}",
            f"Endpoint type: {self.endpoint_type.name}",
            f"Endpoint count: {self.endpoint_count}",
        ]
        gids = [_gid_text(gid) for gid in self.endpoint_gids]
        if self.endpoint_count == 1:
            return "\n".join([*lines, f"GID: {gids[0]}", "QoS profile:", *self._rosidl_profile_lines(0, "  ")])
        labels = [(0, "Request Reader"), (1, "Response Writer")]
        if self.endpoint_type == EndpointTypeEnum.CLIENT:
            labels = [(1, "Request Writer"), (0, "Response Reader")]
        lines += ["GIDs:", *(f" - {label} : {gids[index]}" for index, label in labels), "QoS profiles:"]
        for index, label in labels:
            lines += [f" - {label} :", *self._rosidl_profile_lines(index, "      ")]
        return "\n".join(lines)

    def _rosidl_profile_lines(self, index: int, indent: str) -> list[str]:
        qos = self.qos_profiles[index]
        return _profile_lines(qos, indent, f"{qos.history.name} ({qos.depth})")
