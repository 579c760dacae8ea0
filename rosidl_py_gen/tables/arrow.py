"""pyarrow, for the other modules of this folder: nobody else imports it."""

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
    """``pyarrow.parquet``, which takes a while to load."""
    return import_module("pyarrow.parquet")


def from_numpy(values: Any, kind: Any = None) -> Any:
    """An array of numbers, without a copy unless they are bools; `kind` is another Arrow type of the same bytes."""
    made = pa.array(values)
    return made if kind is None else made.view(kind)


def from_buffers(kind: Any, length: int, *buffers: Any, children: Any = ()) -> Any:
    """An array of a type, none of whose values is null, of the buffers and children that the type has."""
    return pa.Array.from_buffers(kind, length, [None, *map(pa.py_buffer, buffers)], null_count=0, children=[*children])
