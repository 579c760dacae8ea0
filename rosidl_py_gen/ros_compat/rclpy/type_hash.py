"""Type hashes that endpoints announce: the class `TypeHash`."""

from typing import TypedDict

from rclpy._classes import Checked


class TypeHashDictionary(TypedDict):
    """Dict with the arguments of `TypeHash`."""

    version: int
    value: bytes


class TypeHash:
    """Version and value of a type hash (REP 2016); the default stands for an endpoint that announces no hash.

    Attributes:
        version: 1 for RIHS01; -1 for no hash.
        value: the 32 bytes of the hash.

    Raises:
        AssertionError: a value has the wrong type.
    """

    __slots__ = ("_value", "_version")
    _TYPE_HASH_SIZE = 32

    version = Checked[int](int)
    value = Checked[bytes](bytes)

    def __init__(self, version: int = -1, value: bytes = bytes(_TYPE_HASH_SIZE)) -> None:
        self.version = version
        self.value = value

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TypeHash) and (self.version, self.value) == (other.version, other.value)

    def __str__(self) -> str:
        if self.version <= 0 or len(self.value) != self._TYPE_HASH_SIZE:
            return "INVALID"
        return f"RIHS{self.version:02}_{self.value.hex()}"
