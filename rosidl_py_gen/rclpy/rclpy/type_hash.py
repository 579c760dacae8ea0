"""Hashes of types, as endpoints announce them."""

from __future__ import annotations


class TypeHash:
    """Version and value of a hash (REP 2016); by default one that was not announced.

    AssertionError for a version that is no int, and a value that is no bytes.
    """

    __slots__ = ("_value", "_version")
    _TYPE_HASH_SIZE = 32

    def __init__(self, version: int = -1, value: bytes = bytes(_TYPE_HASH_SIZE)) -> None:
        self.version = version
        self.value = value

    @property
    def version(self) -> int:
        """1 for RIHS01; -1 for none."""
        return self._version

    @version.setter
    def version(self, value: int) -> None:
        if not isinstance(value, int):
            raise AssertionError(f"version must be an int, got {value!r:.100}")
        self._version = value

    @property
    def value(self) -> bytes:
        """The hash, 32 bytes."""
        return self._value

    @value.setter
    def value(self, value: bytes) -> None:
        if not isinstance(value, bytes):
            raise AssertionError(f"value must be bytes, got {value!r:.100}")
        self._value = value

    __hash__ = None  # type: ignore[assignment]  # as in rclpy

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TypeHash) and (self.version, self.value) == (other.version, other.value)

    def __str__(self) -> str:
        if self.version <= 0 or len(self.value) != self._TYPE_HASH_SIZE:
            return "INVALID"
        return f"RIHS{self.version:02}_{self.value.hex()}"
