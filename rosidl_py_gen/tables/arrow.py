"""The only importer of pyarrow, for the other modules of this package."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from rosidl_py_gen.base.resources import missing_extra_message

try:
    import pyarrow as _pyarrow  # type: ignore[import-untyped]
except ModuleNotFoundError as missing:
    raise missing_extra_message(missing) or missing from None

pa: Any = _pyarrow


def parquet() -> Any:
    """Return ``pyarrow.parquet``, which is loaded only when it is needed."""
    return import_module("pyarrow.parquet")


def from_numpy(values: Any, kind: Any = None) -> Any:
    """Return an Arrow array of numbers, copied only if they are bools; `kind` is another type of the same bytes."""
    array = pa.array(values)
    return array if kind is None else array.view(kind)


def from_buffers(kind: Any, length: int, *buffers: Any, children: Any = ()) -> Any:
    """Return an Arrow array without nulls, of the buffers and children that its type has."""
    return pa.Array.from_buffers(kind, length, [None, *map(pa.py_buffer, buffers)], null_count=0, children=[*children])
