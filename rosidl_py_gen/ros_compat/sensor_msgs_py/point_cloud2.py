"""Conversion of ``sensor_msgs/msg/PointCloud2`` to structured arrays and back.

Unlike in `rosidl_py_gen.numpy`, a field x with a `count` above 1 becomes several columns x_0, x_1 and so on, and the
array of points has one axis.
"""

from __future__ import annotations

import array
import sys
from collections import namedtuple
from collections.abc import Iterable
from typing import Any

import numpy as np
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from rosidl_py_gen.numpy import ConversionError, pointcloud_to_array
from sensor_msgs_py.numpy_compat import structured_to_unstructured, unstructured_to_structured

Points = np.ndarray[Any, np.dtype[Any]]

DUMMY_FIELD_PREFIX = "unnamed_field"
_DATATYPES: dict[int, np.dtype[Any]] = {
    PointField.INT8: np.dtype(np.int8),
    PointField.UINT8: np.dtype(np.uint8),
    PointField.INT16: np.dtype(np.int16),
    PointField.UINT16: np.dtype(np.uint16),
    PointField.INT32: np.dtype(np.int32),
    PointField.UINT32: np.dtype(np.uint32),
    PointField.FLOAT32: np.dtype(np.float32),
    PointField.FLOAT64: np.dtype(np.float64),
    9: np.dtype(np.int64),
    10: np.dtype(np.uint64),
    11: np.dtype(np.bool_),
}
"""Numpy types by the datatype number of a PointField; the last three are datatypes of PCL and Lyrical."""
_IS_BIG_ENDIAN = sys.byteorder == "big"


def read_points(
    cloud: PointCloud2,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
    reshape_organized_cloud: bool = False,
) -> Points:
    """Return the points as a structured array of one axis, which shares the memory of the cloud if possible.

    Args:
        field_names: fields to read. [default: all]
        skip_nans: skip points with a NaN in one of the fields, unless the cloud is dense.
        uvs: indices of the points to read. [default: all]
        reshape_organized_cloud: return shape ``(width, height)`` if there are several rows.

    Raises:
        AssertionError: `cloud` is not a cloud, a field does not exist, or two fields have the same name.
        TypeError: the cloud has fewer bytes than its sizes require.
    """
    assert isinstance(cloud, PointCloud2), f"expected a sensor_msgs.msg.PointCloud2, got {type(cloud).__name__}"
    points = _read_all_points(cloud)
    if field_names is not None:
        names = list(field_names)
        for name in names:
            assert name in (points.dtype.names or ()), f'no field "{name}" in {points.dtype.names}'
        points = points[names]
    if skip_nans and not cloud.is_dense:
        is_number = np.ones(len(points), np.bool_)
        for name in points.dtype.names or ():
            is_number &= ~np.isnan(points[name])
        points = points[is_number]
    if uvs is not None:
        points = points[uvs if isinstance(uvs, np.ndarray) else np.fromiter(uvs, int)]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.width, cloud.height)
    return points


def _read_all_points(cloud: PointCloud2) -> Points:
    dtype = dtype_from_fields(cloud.fields, point_step=cloud.point_step)
    row = cloud.width * dtype.itemsize
    if cloud.height > 1 and cloud.row_step > row and len(cloud.data) >= cloud.row_step * (cloud.height - 1) + row:
        try:  # rows with padding
            points = pointcloud_to_array(cloud).reshape(-1).view(dtype)
        except ConversionError as error:
            raise TypeError(str(error)) from None
    else:
        points = np.ndarray(cloud.width * cloud.height, dtype, cloud.data)
    if bool(cloud.is_bigendian) != _IS_BIG_ENDIAN:
        points = points.byteswap()
    return points


def read_points_numpy(
    cloud: PointCloud2,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
    reshape_organized_cloud: bool = False,
) -> Points:
    """Return the points as an array of numbers whose last axis has the fields, which must have the same type."""
    names = None if field_names is None else list(field_names)
    kinds = {field.datatype for field in cloud.fields if names is None or field.name in names}
    assert len(kinds) <= 1, "the fields have different types; use read_points"
    points = read_points(cloud, names, skip_nans, uvs, reshape_organized_cloud)
    return structured_to_unstructured(points)


def read_points_list(
    cloud: PointCloud2,
    field_names: Iterable[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[int] | None = None,
) -> list[Any]:
    """Return the points of a cloud as a list of named tuples; arguments and exceptions as for `read_points`."""
    assert isinstance(cloud, PointCloud2), f"expected a sensor_msgs.msg.PointCloud2, got {type(cloud).__name__}"
    names = [field.name for field in cloud.fields] if field_names is None else list(field_names)
    point_class: Any = namedtuple("Point", names)  # type: ignore[misc]
    return [point_class(*point) for point in read_points(cloud, names, skip_nans, uvs)]


def dtype_from_fields(fields: Iterable[PointField], point_step: int | None = None) -> np.dtype[Any]:
    """Return the structured dtype of a point with the given fields.

    Args:
        fields: fields of the cloud, PointField messages.
        point_step: number of bytes of a point. [default: as many as the fields need]

    Raises:
        AssertionError: two fields have the same name, or a count is 0.
        KeyError: a datatype is unknown.
    """
    names: list[str] = []
    formats, offsets = [], []
    for index, field in enumerate(fields):
        kind, name = _DATATYPES[field.datatype], field.name or f"{DUMMY_FIELD_PREFIX}_{index}"
        assert field.count > 0, f'field "{name}" has a count of 0'
        for number in range(field.count):
            column = f"{name}_{number}" if field.count > 1 else name
            assert column not in names, f'there are two fields "{column}"'
            names.append(column)
            formats.append(kind.str)
            offsets.append(field.offset + number * kind.itemsize)
    description = {"names": names, "formats": formats, "offsets": offsets}
    return np.dtype(description if point_step is None else {**description, "itemsize": point_step})  # type: ignore[call-overload,no-any-return]


def create_cloud(
    header: Header, fields: Iterable[PointField], points: Any, point_step: int | None = None
) -> PointCloud2:
    """Create a ``sensor_msgs/msg/PointCloud2``.

    Args:
        points: tuples in the order of the fields; an array of shape ``(n, fields)`` or ``(width, height, fields)`` if
            all fields have the same type; or a structured array with exactly these fields.
        point_step: number of bytes of a point. [default: as many as the fields need]

    Raises:
        AssertionError: the points do not fit the fields.
    """
    fields = list(fields)
    dtype = dtype_from_fields(fields, point_step)
    if not isinstance(points, np.ndarray):
        points = np.array([tuple(point) for point in points], dtype)
    elif points.dtype.names is None:
        assert len({field.datatype for field in fields}) <= 1, "fields of different types need a structured array"
        points = unstructured_to_structured(points, dtype)
    else:
        assert points.dtype == dtype, f"points: expected {dtype}, got {points.dtype}"
    assert points.ndim <= 2, f"points: expected one or two axes, got shape {points.shape}"
    width, height = points.shape if points.ndim == 2 else (points.shape[0], 1)
    cloud = PointCloud2(
        header=header,
        height=height,
        width=width,
        is_dense=False,
        is_bigendian=_IS_BIG_ENDIAN,
        fields=fields,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * width,
    )
    data = array.array("B")
    data.frombytes(np.ascontiguousarray(points).reshape(-1).view(np.uint8).data)
    cloud.data = data
    return cloud


def create_cloud_xyz32(header: Header, points: Any) -> PointCloud2:
    """Create a cloud of points with x, y and z as FLOAT32."""
    offsets = zip("xyz", (0, 4, 8), strict=True)
    fields = [PointField(name=name, offset=offset, datatype=PointField.FLOAT32, count=1) for name, offset in offsets]
    return create_cloud(header, fields, points)
