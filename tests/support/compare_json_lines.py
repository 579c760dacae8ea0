"""Comparison of lines of JSON, except for the last digits of floats."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

DIGITS = 1e-9


def unlike(expected: list[str], found: list[str]) -> list[int]:
    """Return the numbers of the lines that differ."""
    assert len(expected) == len(found)
    return [at for at, pair in enumerate(zip(expected, found, strict=True)) if not _alike(*map(json.loads, pair))]


def _alike(one: Any, two: Any) -> bool:
    if isinstance(one, dict) and isinstance(two, dict):
        if one.keys() == two.keys() and one.get("off"):
            return _alike_pixels(one, two)
        return one.keys() == two.keys() and all(_alike(one[key], two[key]) for key in one)
    if isinstance(one, list) and isinstance(two, list):
        return len(one) == len(two) and all(map(_alike, one, two))
    if isinstance(one, float) and isinstance(two, float | int):
        return (math.isnan(one) and math.isnan(two)) or math.isclose(one, two, rel_tol=DIGITS, abs_tol=DIGITS)
    return type(one) is type(two) and bool(one == two)


def _alike_pixels(one: dict[str, Any], two: dict[str, Any]) -> bool:
    """Integers in hex with the tolerance of each."""
    if one["shape"] != two["shape"] or one["dtype"] != two["dtype"] or one["off"] != two["off"]:
        return False
    dtype = np.dtype(one["dtype"]).newbyteorder("<")
    pixels = [np.frombuffer(bytes.fromhex(each["pixels"]), dtype).astype("f8") for each in (one, two)]
    return bool((abs(pixels[0] - pixels[1]) <= one["off"]).all())
