"""Types that every node announces and few nodes ever use: known by name and hash, imported with their first message.

Importing the messages of the parameter services takes longer than everything else in the start of a node. Decides
nothing; the hashes are those of the bundled modules, and a test compares them.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.runtime.endpoints.types import MessageType, ServiceType, message_type, service_type

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.interface import Payload

SERVICES = {
    "rcl_interfaces/srv/DescribeParameters": (
        "RIHS01_845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
        "RIHS01_05dd1c2bc87dec2627105c8070d6f9725c781a4f2ab852975bf105462b82b644",
        "RIHS01_ad6747319613c6131589e062e095b469a46cc764f7d0f12a001a49e6cd893995",
    ),
    "rcl_interfaces/srv/GetParameterTypes": (
        "RIHS01_da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
        "RIHS01_87d7ec5ef545d4daa289d500025d31fb2437bc8b8365ca367161c4dac4be33fd",
        "RIHS01_ac1335dce67c478e669434f6ac2fbff34fcd529580f272d3006785ba8b54e47f",
    ),
    "rcl_interfaces/srv/GetParameters": (
        "RIHS01_bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
        "RIHS01_135a9e1c3d7cebef792f6687d7ddf99949b21a0bd9a320d863a9110a3f5cf4d6",
        "RIHS01_9fa773b46e39cc5d02db6224d8fd520bb9caeeffc2b27c96c1e59431baba9f2a",
    ),
    "rcl_interfaces/srv/ListParameters": (
        "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
        "RIHS01_a1b0b5d6b967a5b8ac5bc8563c3ea678f349e312a6a4967227c5a96bc5ce38df",
        "RIHS01_31b937b82de3612426be79f231e386259f97e8dc843e3f2845288b4bfa296bdd",
    ),
    "rcl_interfaces/srv/SetParameters": (
        "RIHS01_56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
        "RIHS01_130d46386b7e84ea9ecf60608a4d83cbe5e5cb7c6cc5b712b7a4e3a6c254e932",
        "RIHS01_7a0e8140a0b8d98308fa81a5403a766e610af29a239caf54b7553227906fc266",
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "RIHS01_0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
        "RIHS01_db0bd950ed5ed867a0e90b225e44dea382d762c0762ff3e0ee842190042a59e5",
        "RIHS01_31b1a38c5b0b9d893ee24da45f69638f4561c78461d82d52750f429b534502b8",
    ),
    "type_description_interfaces/srv/GetTypeDescription": (
        "RIHS01_69b9c19c1021405984cc60dbbb1edceb147a6538b411d812ba6afabeed962cd5",
        "RIHS01_470f56ccbcf13d55c78c8b735fb12da03e639e5acded994426c89d94778d9e28",
        "RIHS01_648c49d976240861a482f961c5621ddd0d2135d8cce6f297a76d4f6376d93b75",
    ),
}
"""Name -> RIHS01 of the service, its request and its response."""
MESSAGES = {
    "rcl_interfaces/msg/ParameterEvent": "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
}


def late_service_type(name: str) -> ServiceType[Any, Any]:
    """One of `SERVICES`, as `service_type` would give it."""
    whole, request, response = SERVICES[name]

    @cache
    def known() -> ServiceType[Any, Any]:
        return service_type(_bundled(name))

    return ServiceType(
        name,
        whole,
        _late(f"{name}_Request", request, lambda: known().request),
        _late(f"{name}_Response", response, lambda: known().response),
    )


def late_message_type(name: str) -> MessageType[Any]:
    """One of `MESSAGES`, as `message_type` would give it."""

    @cache
    def known() -> MessageType[Any]:
        return message_type(_bundled(name))

    return _late(name, MESSAGES[name], known)


def _late(name: str, type_hash: str, known: Callable[[], MessageType[Any]]) -> MessageType[Any]:
    def encode(value: Any) -> bytes:
        return known().encode(value)

    def decode(data: Payload) -> Any:
        return known().decode(data)

    return MessageType(name, type_hash, encode, decode)


def _bundled(name: str) -> Any:
    package, kind, stem = name.split("/")
    return getattr(import_module(f"rosidl_py_gen.msgs.{package}.{kind}"), stem)
