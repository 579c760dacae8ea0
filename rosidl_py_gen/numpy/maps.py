"""Conversions between ``nav_msgs/msg/OccupancyGrid`` and arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rosidl_py_gen.numpy.common import ConversionError, M, check_count, flat_bytes, message_class, reads_message

if TYPE_CHECKING:
    from rosidl_py_gen.cdr import Message


@reads_message("a nav_msgs/msg/OccupancyGrid")
def occupancygrid_to_array(grid: Any, *, copy: bool = False) -> np.ndarray[Any, np.dtype[np.int8]]:
    """Return the cells of a map: ``array[row, column]``, -1 unknown, 0 free to 100 occupied; row 0 is at the origin.

    Args:
        copy: return a copy; otherwise the result shares the cells of `grid`.

    Raises:
        ConversionError: `data` does not have ``info.height * info.width`` cells, or is not int8.
    """
    height, width = check_count(grid.info.height, "info.height"), check_count(grid.info.width, "info.width")
    data = flat_bytes(_cells(grid.data), "data")
    if len(data) != height * width:
        raise ConversionError(f"data: {len(data)} cells, but {height} x {width} need {height * width}")
    cells = data.view(np.int8).reshape(height, width)
    return cells.copy() if copy else cells


def _cells(data: Any) -> np.ndarray[Any, np.dtype[np.int8]]:
    try:
        values = np.frombuffer(data, np.int8) if isinstance(data, bytes | bytearray | memoryview) else np.asarray(data)
        cells = values.astype(np.int8, copy=False)
        is_same = cells is values or bool((cells == values).all())
    except (TypeError, ValueError, OverflowError) as error:
        raise ConversionError(f"data: expected int8, got {type(data).__name__}: {error}") from None
    if not is_same:
        raise ConversionError(f"data: expected int8, got {values.dtype} from {values.min()} to {values.max()}")
    return cells


def array_to_occupancygrid(
    array: Any,
    resolution: float,
    *,
    origin: Message | None = None,
    header: Message | None = None,
    cls: type[M] | None = None,
) -> M:
    """Return a map message; the inverse of `occupancygrid_to_array`.

    Args:
        array: integers of shape ``(height, width)``, from -1 to 100.
        resolution: size of a cell, in metres.
        origin: a ``geometry_msgs/msg/Pose`` of cell (0, 0).

    Raises:
        ConversionError: the array has another shape, or values that are not cells.
    """
    cells = np.asarray(array)
    if cells.ndim != 2 or cells.dtype.kind not in "iu":
        raise ConversionError(f"array: expected integers of shape (height, width), got {cells.dtype} {cells.shape}")
    if cells.size and not (cells.min() >= -1 and cells.max() <= 100):
        raise ConversionError(f"array: cells are from -1 to 100, got {cells.min()} to {cells.max()}")
    grid: Any = message_class(cls, "nav_msgs/msg/OccupancyGrid", header)()
    grid.info.height, grid.info.width = cells.shape
    grid.info.resolution = float(resolution)
    if origin is not None:
        grid.info.origin = origin
    grid.data = np.ascontiguousarray(cells, np.int8).reshape(-1)
    return cast("M", grid)
