"""Loader of pyarrow: the other modules of `tables` import pyarrow only from here."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rosidl_py_gen.base.extras import Extra

try:
    import pyarrow as _pyarrow  # type: ignore[import-untyped]
except ModuleNotFoundError as missing:
    raise Extra.missing_error(missing) or missing from None

pa: Any = _pyarrow


def parquet() -> Any:
    """Return the module ``pyarrow.parquet``, which is imported at the first call."""
    return import_module("pyarrow.parquet")


def from_numpy(values: Any, kind: Any = None) -> Any:
    """Return a numpy array of numbers as an Arrow array, copied only if they are bools.

    `kind` is the Arrow type of the result if the bytes of the numbers are to be read as another type of the same size.
    """
    array = pa.array(values)
    return array if kind is None else array.view(kind)


def from_buffers(kind: Any, length: int, *buffers: Any, children: Any = ()) -> Any:
    """Return an Arrow array without nulls from the buffers and child arrays that its type requires."""
    return pa.Array.from_buffers(kind, length, [None, *map(pa.py_buffer, buffers)], null_count=0, children=[*children])
