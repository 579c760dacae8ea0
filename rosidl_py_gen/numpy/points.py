"""Conversions between point clouds and structured arrays, from laser scans, and between maps and arrays of cells."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rosidl_py_gen import get_message
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.numpy.common import (
    ConversionError,
    M,
    as_float64,
    check_count,
    check_flag,
    contiguous_native,
    flat_bytes,
    message_class,
    reads_message,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rosidl_py_gen.cdr import Message

_DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8", 9: "i8", 10: "u8", 11: "b1"}
"""Numpy types of the datatypes in ``sensor_msgs/msg/PointField``, from INT8 to FLOAT64, and of the datatypes that PCL
and Lyrical added."""
_ADDED = frozenset(_DATATYPES[number] for number in (9, 10, 11))
_NUMBERS = {kind: number for number, kind in _DATATYPES.items()}
_MAX_STEP = 2**31 - 1
"""Maximum value of `point_step`, the bytes of a point, that a numpy dtype can describe."""


@reads_message("a sensor_msgs/msg/PointCloud2")
def pointcloud_dtype(cloud: Any) -> np.dtype[Any]:
    """Return the structured dtype of a cloud's points: names, offsets and byte order of its fields, size `point_step`.

    Raises:
        ConversionError: a field has an unknown datatype, does not fit into `point_step`, or two have one name; or
            `point_step` is too large for numpy.
    """
    step = check_count(cloud.point_step, "point_step")
    if step > _MAX_STEP:
        raise ConversionError(f"point_step: {step} bytes, but a point of an array has at most {_MAX_STEP}")
    order = "<>"[check_flag(cloud.is_bigendian, "is_bigendian")]
    names, formats, offsets = [], [], []
    for index, field in enumerate(cloud.fields):
        place = f"fields[{index}]"
        kind = _DATATYPES.get(int(field.datatype))
        if kind is None:
            raise ConversionError(f'{place}.datatype: {field.datatype} is not known ("{field.name}")')
        name = field.name or f"unnamed_field_{index}"
        if name in names:
            raise ConversionError(f'{place}.name: there are two fields "{name}"')
        number = check_count(field.count, f"{place}.count") or 1  # 0 is written by some and means 1
        offset = check_count(field.offset, f"{place}.offset")
        if offset + int(kind[1]) * number > step:
            end = offset + int(kind[1]) * number
            raise ConversionError(f'{place}: "{name}" ends at byte {end}, but point_step is {step}')
        names.append(name)
        formats.append((order + kind, (number,) if number > 1 else ()))
        offsets.append(offset)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})


@reads_message("a sensor_msgs/msg/PointCloud2")
def pointcloud_to_array(
    cloud: Any, fields: Sequence[str] | None = None, *, copy: bool = False, skip_nans: bool = False
) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return the points of a ``sensor_msgs/msg/PointCloud2``; ``points["x"]`` is the column of all x.

    Args:
        fields: names of the fields to return; None returns all.
        copy: return a copy without the bytes between fields; otherwise the result shares the bytes of `cloud`, and is
            read-only if those are.
        skip_nans: exclude points that have a NaN in one of the fields. The result is then a one-dimensional copy, also
            for an organised cloud. The field `is_dense` is ignored.

    Returns:
        Structured array of shape ``(width,)``, or ``(height, width)`` for an organised cloud. A field with a `count`
        above 1 is an array in each point.

    Raises:
        ConversionError: a field of the cloud is invalid; rows or data are too short; or a name in `fields` does not
            exist.
    """
    dtype = pointcloud_dtype(cloud)
    height, width, row_step = (check_count(getattr(cloud, name), name) for name in ("height", "width", "row_step"))
    row = width * dtype.itemsize
    if height <= 1:
        row_step = row
    if row_step < row:
        raise ConversionError(f"row_step: {row_step} bytes, but {width} points of {dtype.itemsize} need {row}")
    data = flat_bytes(cloud.data, "data")
    needed = row_step * (height - 1) + row if height and row else 0
    if len(data) < needed:
        raise ConversionError(f"data: {len(data)} bytes, but {height} x {width} points need {needed}")
    if height * width and not dtype.itemsize:
        raise ConversionError(f"point_step: 0 bytes, but there are {height} x {width} points")
    array: np.ndarray[Any, Any] = np.ndarray((height, width), dtype, data[:needed], strides=(row_step, dtype.itemsize))
    array = array[0] if height == 1 else array.reshape(0) if not array.size else array
    _check_bools(array)
    if fields is not None:
        names = dtype.names or ()
        for name in fields:
            if name not in names:
                raise ConversionError(f'no field "{name}" in {", ".join(names)}{did_you_mean(name, names)}')
        array = array[list(fields)]
    if skip_nans:
        array = array[~_has_nan(array)]
    if not copy:
        return array
    packed = [(name, array.dtype[name].newbyteorder("=")) for name in array.dtype.names or ()]
    return array.astype(np.dtype(packed))


def _check_bools(points: np.ndarray[Any, Any]) -> None:
    """Raise `ConversionError` if a byte of a bool field is neither 0 nor 1: numpy would compute wrong results."""
    for name in points.dtype.names or ():
        if points.dtype[name].base.kind == "b" and points.size:
            offset, shape = points.dtype.fields[name][1], points.dtype[name].shape
            form: Any = {
                "names": ["byte"],
                "formats": [("u1", shape)],
                "offsets": [offset],
                "itemsize": points.itemsize,
            }
            largest = points.view(np.dtype(form))["byte"].max()
            if largest > 1:
                raise ConversionError(f'"{name}": {largest} is not a bool; expected 0 or 1')


def _has_nan(points: np.ndarray[Any, Any]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    result = np.zeros(points.shape, np.bool_)
    for name in points.dtype.names or ():
        column = points[name]
        if column.dtype.kind == "f" and column.size:
            result |= np.isnan(column).reshape(*points.shape, -1).any(-1)
    return result


def points_to_xyz(points: Any, *, skip_nans: bool = False) -> np.ndarray[Any, np.dtype[np.floating[Any]]]:
    """Return x, y and z of structured points, such as `pointcloud_to_array` returns, with shape ``(..., 3)``.

    Args:
        skip_nans: exclude points of which x, y or z is NaN; the result then has shape ``(n, 3)``.

    Raises:
        ConversionError: x, y or z is missing, or not a number.
    """
    array = np.asarray(points)
    names = array.dtype.names or ()
    for name in ("x", "y", "z"):
        if name not in names or array.dtype[name].kind not in "iuf" or array.dtype[name].shape:
            raise ConversionError(f"points: expected numbers x, y and z, got {array.dtype!s:.200}")
    kinds = {array.dtype[name].newbyteorder("=") for name in ("x", "y", "z")}
    columns = np.stack([array[name] for name in ("x", "y", "z")], -1)
    rows: np.ndarray[Any, Any] = columns.astype(np.result_type(np.float32, *kinds), copy=False)
    if skip_nans:
        rows = rows.reshape(-1, 3)
        rows = rows[~np.isnan(rows).any(-1)]
    return rows


def array_to_pointcloud(
    array: Any,
    *,
    names: Sequence[str] = ("x", "y", "z"),
    dtype: Any = None,
    header: Message | None = None,
    cls: type[M] | None = None,
    is_dense: bool | None = None,
) -> M:
    """Return a point cloud message with the points of an array, the inverse of `pointcloud_to_array`.

    Args:
        array: structured, of shape ``(n,)`` or ``(height, width)``; or plain numbers whose last axis has the fields
            `names`. An array that is contiguous and has no gaps is not copied.
        dtype: type of the fields of plain numbers; None keeps the dtype of the array, which makes FLOAT64 fields of
            float64. RViz and PCL read x, y and z only as FLOAT32: ``"f4"``.
        header: a ``std_msgs/msg/Header``.
        cls: class of the message; None uses `get_message`.
        is_dense: True states that all values are finite; None checks the values.

    Raises:
        ConversionError: a field has a type that point clouds do not have, the shape does not fit, or a number is out of
            the range of `dtype`.
    """
    points = np.asarray(array)
    if points.dtype.names is None:
        if dtype is None and f"{points.dtype.kind}{points.dtype.itemsize}" in _ADDED:
            text = f"array: {points.dtype} is a type that RViz and older readers of point fields do not know"
            raise ConversionError(f'{text}; pass dtype="f4", or dtype="{points.dtype}" to use it')
        numbers = points if dtype is None else _as_kind(points, np.dtype(dtype))
        if not numbers.ndim or numbers.shape[-1] != len(names):
            expected = f"{len(names)} columns ({', '.join(names)})"
            raise ConversionError(f"array: expected {expected}, got shape {numbers.shape}")
        record = np.dtype([(name, numbers.dtype) for name in names])
        points = np.ascontiguousarray(numbers).view(record)[..., 0]
    elif dtype is not None:
        raise ConversionError(f"dtype= cannot be passed for a structured array; this one has {points.dtype}")
    if points.ndim not in (1, 2):
        raise ConversionError(f"array: expected one or two axes of points, got shape {points.shape}")
    points, is_big = _writable(points)
    height, width = points.shape if points.ndim == 2 else (1, len(points))
    if is_dense is None:
        columns = (points[name] for name in points.dtype.names or ())
        is_dense = all(bool(np.isfinite(column).all()) for column in columns if column.dtype.kind == "f")
    return message_class(cls, "sensor_msgs/msg/PointCloud2", header)(
        height=height,
        width=width,
        fields=[_field(points.dtype, name, cls) for name in points.dtype.names or ()],
        is_bigendian=is_big,
        point_step=points.dtype.itemsize,
        row_step=points.dtype.itemsize * width,
        data=points.reshape(-1).view(np.uint8),
        is_dense=is_dense,
    )


def _as_kind(values: np.ndarray[Any, Any], kind: np.dtype[Any]) -> np.ndarray[Any, Any]:
    """Return numbers converted to another numpy type; floats are rounded to its precision.

    Raises `ConversionError` if a number is out of the type's range, or has a fraction and the type is an integer.
    """
    if kind == values.dtype:
        return values
    if kind.kind not in "iuf" or values.dtype.kind not in "biuf":
        raise ConversionError(f"array: {values.dtype} as {kind}: expected numbers; point fields are {_known_types()}")
    with np.errstate(all="ignore"):
        result = values.astype(kind)
        lost = (np.isfinite(values) & ~np.isfinite(result)) if kind.kind == "f" else result != values
    if lost.any():
        value = values[lost].flat[0]
        has_fraction = kind.kind != "f" and np.isfinite(value) and value != np.trunc(value)
        reason = "has a fraction; expected an integer for" if has_fraction else "is out of the range of"
        raise ConversionError(f"array: {value!r} {reason} {kind}")
    return result


def _writable(points: np.ndarray[Any, Any]) -> tuple[np.ndarray[Any, Any], bool]:
    """Return structured points in contiguous memory and in one byte order, and True if the byte order is big-endian.

    Bytes between fields are zero. Raises `ConversionError` for a type that point clouds do not have.
    """
    dtype = points.dtype
    kinds = {name: dtype[name].base for name in dtype.names or ()}
    for name, kind in kinds.items():
        if f"{kind.kind}{kind.itemsize}" not in _NUMBERS:
            raise ConversionError(f'array["{name}"]: {kind} is not a type of point fields; these are {_known_types()}')
    orders = {contiguous_native(np.empty(0, kind))[1] for kind in kinds.values() if kind.itemsize > 1}
    has_gaps = sum(dtype[name].itemsize for name in kinds) != dtype.itemsize
    if len(orders) > 1 or has_gaps:
        formats = [dtype[name].newbyteorder("<") for name in kinds]
        offsets = [dtype.fields[name][1] for name in kinds] if dtype.fields else []
        clean = np.dtype({"names": list(kinds), "formats": formats, "offsets": offsets, "itemsize": dtype.itemsize})
        filled = np.zeros(points.shape, clean)
        for name in kinds:
            filled[name] = points[name]
        return filled, False
    return np.ascontiguousarray(points), any(orders)


def _known_types() -> str:
    return ", ".join(str(np.dtype(kind)) for kind in _NUMBERS)


def _field(dtype: np.dtype[Any], name: str, cloud: type[Any] | None) -> Any:
    kind, shape = dtype[name].base, dtype[name].shape
    offset = dtype.fields[name][1] if dtype.fields else 0
    cls: Any = get_message("sensor_msgs/msg/PointField")
    if cloud is not None:
        cls = next((field.cls for field in cloud._TYPE.fields if field.ros_name == "fields"), None)
        if cls is None:
            raise ConversionError(f"{cloud.__name__} is not a PointCloud2: it has no field called fields")
    number = int(np.prod(shape)) if shape else 1
    return cls(name=name, offset=offset, datatype=_NUMBERS[f"{kind.kind}{kind.itemsize}"], count=number)


# ---------------------------------------------------------------------------------------------------------------- scans


@reads_message("a sensor_msgs/msg/LaserScan")
def laserscan_to_points(scan: Any, *, skip_invalid: bool = True) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return the points that a ``sensor_msgs/msg/LaserScan`` measured, in the frame of the scan, with z = 0.

    The scanner is assumed not to move while it turns.

    Args:
        skip_invalid: exclude ranges below `range_min`, above `range_max`, or NaN; otherwise these are points of NaN,
            and the point of ``ranges[i]`` is ``points[i]``.

    Returns:
        Structured array, as of `pointcloud_to_array` and for `array_to_pointcloud`: x, y and z of float32, and
        intensity if the scan has intensities. `points_to_xyz` returns its plain columns.

    Raises:
        ConversionError: a field is not a number, or the numbers of intensities and ranges differ.
    """
    ranges, intensities = _numbers(scan, "ranges"), _numbers(scan, "intensities")
    if intensities.size not in (0, ranges.size):
        raise ConversionError(f"intensities: {intensities.size}, but there are {ranges.size} ranges")
    first, step, low, high = (
        _number(scan, name) for name in ("angle_min", "angle_increment", "range_min", "range_max")
    )
    for name, value in (("angle_min", first), ("angle_increment", step)):
        if not np.isfinite(value):
            raise ConversionError(f"{name}: expected a number of radians, got {value}")
    with np.errstate(invalid="ignore"):
        is_seen = (ranges >= low) & (ranges <= high) & np.isfinite(ranges)
    angles = first + step * np.arange(ranges.size, dtype=np.float64)
    names = ["x", "y", "z", *(["intensity"] if intensities.size else [])]
    points = np.zeros(ranges.size, [(name, np.float32) for name in names])
    distance = np.where(is_seen, ranges, np.nan)
    points["x"], points["y"] = distance * np.cos(angles), distance * np.sin(angles)
    points["z"][~is_seen] = np.nan
    if intensities.size:
        points["intensity"] = intensities
    return points[is_seen] if skip_invalid else points


def _numbers(scan: Any, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    values = as_float64(getattr(scan, name), "numbers", f"{name}: ")
    if values.ndim != 1:
        raise ConversionError(f"{name}: expected a row of numbers, got shape {values.shape}")
    return values


def _number(scan: Any, name: str) -> float:
    value = getattr(scan, name)
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ConversionError(f"{name}: expected a number, got {value!r:.50}") from None


# ---------------------------------------------------------------------------------------------------------------- maps


@reads_message("a nav_msgs/msg/OccupancyGrid")
def occupancygrid_to_array(grid: Any, *, copy: bool = False) -> np.ndarray[Any, np.dtype[np.int8]]:
    """Return the cells of a map as ``array[row, column]``, with row 0 at the map's origin.

    A cell is -1 if unknown, else from 0 (free) to 100 (occupied).

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
    """Return a map message with the cells of an array, the inverse of `occupancygrid_to_array`.

    Args:
        array: integers of shape ``(height, width)``, from -1 to 100.
        resolution: size of a cell, in metres.
        origin: a ``geometry_msgs/msg/Pose`` of cell (0, 0).
        header: a ``std_msgs/msg/Header``.
        cls: class of the message; None uses `get_message`.

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
