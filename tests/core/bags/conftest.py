"""A memory limit for tests."""

from support.limited_memory import little_memory

__all__ = ["little_memory"]
