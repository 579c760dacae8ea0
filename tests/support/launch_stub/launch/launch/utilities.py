"""Helpers of substitutions."""

from __future__ import annotations

from typing import Any


def normalize_to_list_of_substitutions(value: Any) -> list[Any]:
    return [*value] if isinstance(value, (list, tuple)) else [value]


def perform_substitutions(context: Any, parts: list[Any]) -> str:
    return "".join(one if isinstance(one, str) else one.perform(context) for one in parts)
