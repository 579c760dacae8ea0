"""Lengths, and vectors of length one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Array = np.ndarray[Any, np.dtype[np.float64]]
_EPS = np.finfo(np.float64).eps * 4.0


def vector_norm(data: Any, axis: int | None = None, out: Any = None) -> Any:
    """The length of a vector, or an array of lengths along `axis`; nothing where `out` takes them."""
    values = np.asarray(data, np.float64)
    if out is not None:
        np.sqrt(np.sum(values * values, axis=axis), out=out)
        return None
    if values.ndim == 1:
        return math.sqrt(np.dot(values, values))
    return np.sqrt(np.atleast_1d(np.sum(values * values, axis=axis)))


def unit_vector(data: Any, axis: int | None = None, out: Any = None) -> Any:
    """The data divided by its length, along `axis`; nothing where `out` takes it."""
    values = np.array(data, np.float64)
    length = np.sqrt(np.sum(values * values, axis=axis, keepdims=axis is not None))
    if out is not None:
        out[...] = values / length
        return None
    with np.errstate(invalid="ignore"):
        values /= length
    return values


def random_vector(size: Any) -> Any:
    """Numbers from 0 to 1, without 1."""
    return np.random.random(size)
