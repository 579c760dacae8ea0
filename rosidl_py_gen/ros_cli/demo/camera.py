"""Camera of the demo: a lifecycle node that publishes pictures of the room while it is active."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from rosidl_py_gen import ExtraMissingError, get_message
from rosidl_py_gen.numpy import array_to_compressedimage, array_to_image
from rosidl_py_gen.runtime import LifecycleNode, Range, State

if TYPE_CHECKING:
    from rosidl_py_gen.ros_cli.demo.schedule import Schedule
    from rosidl_py_gen.ros_cli.demo.world import Array, Body, World

CameraInfo: Any = get_message("sensor_msgs/msg/CameraInfo")
CompressedImage: Any = get_message("sensor_msgs/msg/CompressedImage")
Header: Any = get_message("std_msgs/msg/Header")
Image: Any = get_message("sensor_msgs/msg/Image")

FORWARD_M, HEIGHT_M = 0.15, 0.3
"""Position of the demo camera on the robot in metres: distance forwards from the centre, and height."""
_WIDTH, _HEIGHT = 160, 120
_FOCAL_LENGTH = 115.0
"""Focal length of the demo camera in pixels; with it the picture is 70 degrees wide."""
_WALL_HEIGHT_M = 0.6
_CEILING, _FLOOR = (150, 180, 205), (110, 95, 80)
_FADE_M = 8.0
"""Distance in metres in which colours in the camera's pictures become darker by the factor e."""


@dataclass
class CameraParameters:
    image_rate: Annotated[float, Range(0.5, 30.0), "Images per second."] = 5.0


class Camera(LifecycleNode):
    """Lifecycle node ``camera`` of the demo: publishes ``camera/image_raw``, ``camera/camera_info`` and, with Pillow,
    compressed images.
    """

    def __init__(
        self, schedule: Schedule, world: World, body: Body, frame: str, namespace: str, **node_options: Any
    ) -> None:
        super().__init__("camera", namespace, **node_options)
        self._schedule, self._world, self._body, self._frame = schedule, world, body, frame
        self._parameters = self.declare_parameters(CameraParameters)
        schedule.every(lambda: self._parameters.image_rate, self._shoot)

    def on_configure(self, state: State) -> None:
        self._images = self.create_lifecycle_publisher(Image, "camera/image_raw")
        self._calibrations = self.create_lifecycle_publisher(CameraInfo, "camera/camera_info")
        self._compressed = None
        if missing_pillow() is None:
            self._compressed = self.create_lifecycle_publisher(CompressedImage, "camera/image_raw/compressed")

    def on_cleanup(self, state: State) -> None:
        for publisher in (self._images, self._calibrations, self._compressed):
            if publisher is not None:
                publisher.close()

    def _shoot(self) -> None:
        if self.state is not State.ACTIVE:
            return
        header = Header(stamp=self._schedule.now.to_msg(), frame_id=self._frame)
        picture = render(self._world, self._body)
        self._images.publish(array_to_image(picture, "rgb8", header=header, cls=Image))
        self._calibrations.publish(camera_info(header))
        if self._compressed is not None:
            compressed = array_to_compressedimage(picture, "rgb8", header=header, cls=CompressedImage)
            self._compressed.publish(compressed)


def missing_pillow() -> ExtraMissingError | None:
    """Return the reason why the camera publishes no compressed images.

    Returns None if Pillow is installed (extra ``images``).
    """
    try:
        array_to_compressedimage(np.zeros((1, 1), np.uint8), cls=CompressedImage)
    except ExtraMissingError as error:
        return error
    return None


def camera_info(header: Any) -> Any:
    """Return the calibration message of the demo camera: a pinhole camera without distortion."""
    info = CameraInfo(header=header, width=_WIDTH, height=_HEIGHT, distortion_model="plumb_bob", d=[0.0] * 5)
    f, x, y = _FOCAL_LENGTH, _WIDTH / 2 - 0.5, _HEIGHT / 2 - 0.5
    info.k = [f, 0.0, x, 0.0, f, y, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [f, 0.0, x, 0.0, 0.0, f, y, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


def render(world: World, body: Body) -> Array:
    """Return the picture that a camera on a body sees, as RGB of shape ``(height, width, 3)``.

    One ray is cast for each column of the picture.
    """
    x, y = body.x + FORWARD_M * math.cos(body.yaw), body.y + FORWARD_M * math.sin(body.yaw)
    columns = -np.arctan((np.arange(_WIDTH) + 0.5 - _WIDTH / 2) / _FOCAL_LENGTH)  # left is positive
    lengths, colors = world.cast(x, y, body.yaw + columns, body)
    # The height of a wall in the picture depends on its distance along the axis of the camera, not along the ray.
    scale = _FOCAL_LENGTH / np.maximum(lengths * np.cos(columns), 1e-3)
    top = _HEIGHT / 2 - scale * (_WALL_HEIGHT_M - HEIGHT_M)
    bottom = _HEIGHT / 2 + scale * HEIGHT_M
    rows = np.arange(_HEIGHT)[:, None] + 0.5
    walls = (colors * np.exp(-lengths / _FADE_M)[:, None]).astype(np.uint8)
    picture = np.where((rows < top)[..., None], np.array(_CEILING, np.uint8), walls)
    return np.where((rows > bottom)[..., None], np.array(_FLOOR, np.uint8), picture)
