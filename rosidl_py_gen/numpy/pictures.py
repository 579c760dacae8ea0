"""Pictures of messages for notebooks, by Pillow (extra ``images``): PNGs of images, maps, clouds, scans and paths.

A picture has at most 640 pixels on each side. Large messages are thinned out before they are converted, so a picture
takes a few milliseconds.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np

from rosidl_py_gen.errors import ExtraMissingError
from rosidl_py_gen.numpy.common import ConversionError, escaped, flat_bytes
from rosidl_py_gen.numpy.images import compressedimage_to_array, convert_pixels, image_to_array, pillow_image
from rosidl_py_gen.numpy.points import laserscan_to_points, occupancygrid_to_array, pointcloud_to_array, points_to_xyz

_Pixels = np.ndarray[Any, np.dtype[np.uint8]]
_Numbers = np.ndarray[Any, np.dtype[Any]]
_MAX_SIDE = 640
_MAX_PIXELS = 32_000_000
"""Maximum pixels of an image that is converted completely for drawing, because rows and columns of its encoding cannot
be left out before."""
_MAX_PLAIN_BYTES = 2_000_000
_SIDE, _MIN_SIDE, _MARGIN = 480, 40, 10
_MAX_POINTS = 200_000
_MAX_LARGE_POINTS = 50_000
_BY_BLOCKS = ("bayer_", "yuv422", "uyvy", "yuyv", "nv21", "nv24")
"""Prefixes of image encodings whose pixels share colours with their neighbours, so that single pixels cannot be
removed."""
_HEIGHTS = np.array([[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]], float)
_WHITE, _BLUE, _RED, _GREEN = (255, 255, 255), (31, 119, 180), (214, 39, 40), (44, 160, 44)


class _Drawn(NamedTuple):
    data: bytes
    caption: str
    media: str = "image/png"


def picture_html(message: Any) -> str | None:
    """Return a picture of a message with its caption in HTML; None if there is no picture for its type.

    Raises:
        ConversionError: the message cannot be drawn. Damaged messages may raise other errors.
        ExtraMissingError: Pillow is not installed.
    """
    draw = _PICTURES.get(message._TYPE.name)
    if draw is None:
        return None
    drawn = draw(message)
    source = f"data:{drawn.media};base64,{base64.b64encode(drawn.data).decode()}"
    style = f"max-width: {_MAX_SIDE}px; min-width: 160px; image-rendering: pixelated"
    caption = escaped(drawn.caption)
    return f'<div><img alt="{caption}" src="{source}" style="{style}"></div><div>{caption}</div>'


def png(pixels: _Pixels) -> bytes:
    """Return 8-bit pixels as PNG: ``(height, width)`` for gray ones, ``(height, width, 3)`` for colours."""
    out = BytesIO()
    pillow_image().fromarray(pixels).save(out, "PNG")
    return out.getvalue()


# --------------------------------------------------------------------------------------------------------------- images


def _image(image: Any) -> _Drawn:
    array, encoding = image_to_array(image), image.encoding
    size = f"{image.width} x {image.height}, {encoding}"
    _require_pixels(array, size)
    if encoding.startswith(_BY_BLOCKS):
        if array.size > _MAX_PIXELS:
            raise ConversionError(f"{size}: too large for a picture of this encoding")
        return _Drawn(png(_thinned(convert_pixels(array, encoding, "rgb8"))), size)
    small = _thinned(array)
    try:
        return _Drawn(png(convert_pixels(small, encoding, "mono8" if small.ndim == 2 else "rgb8")), size)
    except ConversionError:  # no colours: depths, or others
        return _scaled(small, size)


def _compressed_image(image: Any) -> _Drawn:
    try:
        array = compressedimage_to_array(image)
    except ExtraMissingError:
        data = flat_bytes(image.data, "data").tobytes()
        media = "image/jpeg" if data[:3] == b"\xff\xd8\xff" else "image/png" if data[:4] == b"\x89PNG" else ""
        if not media or len(data) > _MAX_PLAIN_BYTES:
            raise
        return _Drawn(data, image.format, media)
    size = f"{array.shape[1]} x {array.shape[0]}, {image.format}"
    _require_pixels(array, size)
    small = _thinned(array[..., :3] if array.ndim == 3 else array)
    return _Drawn(png(small), size) if small.dtype == np.uint8 else _scaled(small, size)


def _require_pixels(array: _Numbers, size: str) -> None:
    if not array.size:
        raise ConversionError(f"{size}: no pixels")


def _thinned(array: _Numbers) -> Any:
    """Return every n-th row and column of an image, so that it has at most 640 rows and columns."""
    step = -(-max(array.shape[:2]) // _MAX_SIDE)
    return np.ascontiguousarray(array[::step, ::step])


def _scaled(values: _Numbers, size: str) -> _Drawn:
    """Return numbers of any range as a gray picture in which small numbers are dark.

    Numbers that are not finite are black.
    """
    plane = (values if values.ndim == 2 else values[..., 0]).astype(np.float64)
    known = np.isfinite(plane)
    if not known.any():
        raise ConversionError(f"{size}: no pixel is a finite number")
    low, high = float(plane[known].min()), float(plane[known].max())
    gray = np.zeros(plane.shape, np.uint8)
    gray[known] = 30 + (plane[known] - low) / ((high - low) or 1.0) * 225
    return _Drawn(png(gray), f"{size}, values from {low:g} to {high:g}")


# ----------------------------------------------------------------------------------------------------------------- maps


def _grid(grid: Any) -> _Drawn:
    cells = occupancygrid_to_array(grid)
    size = f"{grid.info.width} x {grid.info.height} cells of {grid.info.resolution:g} m"
    _require_pixels(cells, size)
    step = -(-max(cells.shape) // _MAX_SIDE)
    if step > 1:  # the highest of several cells, so that thin walls stay visible
        for axis in (0, 1):
            cells = np.maximum.reduceat(cells, np.arange(0, cells.shape[axis], step), axis)
    values = np.clip(cells.astype(np.int16), -1, 100)
    gray = np.where(values < 0, 160, 255 - values * 255 // 100).astype(np.uint8)
    return _Drawn(png(gray[::-1]), f"{size}; white is free, black is occupied")


# --------------------------------------------------------------------------------------------------------------- points


class _TopView:
    """Picture of points seen from above: x to the right, y upwards, with one scale for both."""

    def __init__(self, x: _Numbers, y: _Numbers, caption: str) -> None:
        if not len(x):
            raise ConversionError(f"{caption}: no finite points")
        ends = (0.0, 100.0) if len(x) < 1000 else (0.2, 99.8)  # a few points far away would shrink all others
        (left, right), (bottom, top) = np.percentile(x, ends), np.percentile(y, ends)
        self._scale = (_SIDE - 2 * _MARGIN) / (max(right - left, top - bottom) or 1.0)
        self._x, self._y = (left + right) / 2, (bottom + top) / 2
        if not np.isfinite([self._scale, self._x, self._y]).all():
            raise ConversionError(f"{caption}: the coordinates are too large")
        self._caption = f"{caption}; x from {left:.4g} to {right:.4g} m, y from {bottom:.4g} to {top:.4g} m"
        self._height, self._width = (
            max(_MIN_SIDE, round(length * self._scale) + 2 * _MARGIN) for length in (top - bottom, right - left)
        )
        self._pixels: _Pixels = np.full((self._height, self._width, 3), 255, np.uint8)

    def draw(self, x: _Numbers, y: _Numbers, colors: Any, radius: int) -> None:
        """Draw points as squares into the picture.

        `colors` is one colour, or an array with one colour for each point.
        """
        across = np.clip((x - self._x) * self._scale, -_SIDE, _SIDE) + self._width / 2
        down = np.clip((self._y - y) * self._scale, -_SIDE, _SIDE) + self._height / 2
        columns, rows = np.rint(across).astype(np.intp), np.rint(down).astype(np.intp)
        for lower in range(-radius, radius + 1):
            for right in range(-radius, radius + 1):
                row, column = rows + lower, columns + right
                inside = (row >= 0) & (row < self._height) & (column >= 0) & (column < self._width)
                self._pixels[row[inside], column[inside]] = colors[inside] if isinstance(colors, np.ndarray) else colors

    def drawn(self) -> _Drawn:
        return _Drawn(png(self._pixels), self._caption)


def _cloud(cloud: Any) -> _Drawn:
    points = pointcloud_to_array(cloud, ["x", "y", "z"])
    count = points.size
    flat = points.reshape(-1)[:: -(-count // _MAX_POINTS) or 1]
    xyz = points_to_xyz(flat).astype(np.float64)
    xyz = xyz[np.isfinite(xyz).all(1)]
    view = _TopView(xyz[:, 0], xyz[:, 1], f"{count} points from above")
    order = np.argsort(xyz[:, 2])  # the highest are drawn last
    xyz = xyz[order]
    low, high = np.percentile(xyz[:, 2], (2, 98))
    place = np.clip((xyz[:, 2] - low) / ((high - low) or 1.0), 0, 1) * (len(_HEIGHTS) - 1)
    colors = np.stack([np.interp(place, np.arange(len(_HEIGHTS)), _HEIGHTS[:, one]) for one in range(3)], 1)
    view.draw(xyz[:, 0], xyz[:, 1], colors.astype(np.uint8), 1 if len(xyz) < _MAX_LARGE_POINTS else 0)
    return view.drawn()


def _scan(scan: Any) -> _Drawn:
    points = laserscan_to_points(scan)
    caption = f"{len(points)} of {len(scan.ranges)} ranges"
    points = points[:: -(-len(points) // _MAX_POINTS) or 1]
    x, y = points["x"].astype(np.float64), points["y"].astype(np.float64)
    if not len(x):
        raise ConversionError(f"{caption}: no finite points")
    origin = np.zeros(1)
    view = _TopView(np.append(x, 0.0), np.append(y, 0.0), caption)
    view.draw(x, y, _BLUE, 1)
    view.draw(origin, origin, _RED, 3)
    return view.drawn()


def _path(path: Any) -> _Drawn:
    poses, count = path.poses, len(path.poses)
    step = -(-count // _MAX_POINTS) or 1
    if isinstance(poses, np.ndarray):
        position = poses[::step]["pose"]["position"]
        x, y = position["x"].astype(np.float64), position["y"].astype(np.float64)
    else:
        places = [one.pose.position for one in poses[::step]]
        x, y = np.array([one.x for one in places], float), np.array([one.y for one in places], float)
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    view = _TopView(x, y, f"{count} poses")
    part = np.linspace(0, 1, max(2, min(2 * _SIDE, 2_000_000 // max(1, len(x)))))
    between_x, between_y = (np.append((one[:-1, None] + np.diff(one)[:, None] * part).ravel(), one) for one in (x, y))
    view.draw(between_x, between_y, _BLUE, 0 if len(x) > 5000 else 1)
    view.draw(x[:1], y[:1], _GREEN, 4)
    view.draw(x[-1:], y[-1:], _RED, 4)
    return view.drawn()


_PICTURES: dict[str, Callable[[Any], _Drawn]] = {
    "nav_msgs/msg/OccupancyGrid": _grid,
    "nav_msgs/msg/Path": _path,
    "sensor_msgs/msg/CompressedImage": _compressed_image,
    "sensor_msgs/msg/Image": _image,
    "sensor_msgs/msg/LaserScan": _scan,
    "sensor_msgs/msg/PointCloud2": _cloud,
}
