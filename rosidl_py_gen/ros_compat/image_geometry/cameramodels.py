"""Models of one camera and of two cameras, from ``sensor_msgs/msg/CameraInfo``.

Matrices are objects of `numpy.matrix`, as in the real package: ``*`` is the matrix product. Before `fromCameraInfo` all
attributes are None.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

Matrix = np.matrix[Any, np.dtype[np.float64]]
Pair = tuple[float, float]
Triple = tuple[float, float, float]


def mkmat(rows: int, cols: int, L: Any) -> Matrix:
    """Return a matrix of the given shape, with the numbers of `L` row by row."""
    return np.matrix(np.reshape(np.asarray(L, np.float64), (rows, cols)))


def _opencv() -> Any:
    try:
        return import_module("cv2")
    except ModuleNotFoundError as error:
        text = "image_geometry needs OpenCV to rectify; install opencv-python-headless"
        raise ModuleNotFoundError(text, name=error.name) from None


def _entry(row: int, column: int, text: str) -> Callable[[PinholeCameraModel], Any]:
    """Return a method that returns one number of the projection matrix P.

    Args:
        row: row of the number.
        column: column of the number.
        text: docstring of the method.
    """

    def get(self: PinholeCameraModel) -> Any:
        return self.P[row, column]

    get.__doc__ = text
    return get


class PinholeCameraModel:
    """Model of a camera with a pinhole projection.

    Attributes:
        K: camera matrix, 3 x 3, of the binned region of interest.
        D: distortion coefficients, n x 1; None without distortion.
        R: rectifying rotation, 3 x 3.
        P: projection, 3 x 4, of the binned region of interest.
        full_K: camera matrix of the full resolution.
        full_P: projection of the full resolution.
        width: full resolution in pixels, like `height`.
        binning_x: number of pixels that are combined to one pixel, like `binning_y`.
        raw_roi: region of interest, a ``sensor_msgs/msg/RegionOfInterest``; the whole image if none is set.
        tf_frame: frame of the camera.
        stamp: time of the CameraInfo.
    """

    def __init__(self) -> None:
        self.K: Any = None
        self.D: Matrix | None = None
        self.R: Any = None
        self.P: Any = None
        self.full_K: Any = None
        self.full_P: Any = None
        self.width: Any = None
        self.height: Any = None
        self.binning_x: Any = None
        self.binning_y: Any = None
        self.raw_roi: Any = None
        self.tf_frame: Any = None
        self.stamp: Any = None

    def fromCameraInfo(self, msg: Any) -> None:
        """Read the parameters of a ``sensor_msgs/msg/CameraInfo``."""
        self.full_K, self.full_P, self.R = mkmat(3, 3, msg.k), mkmat(3, 4, msg.p), mkmat(3, 3, msg.r)
        self.D = mkmat(len(msg.d), 1, msg.d) if len(msg.d) else None
        self.width, self.height = self.resolution = (msg.width, msg.height)
        self.binning_x, self.binning_y = max(1, msg.binning_x), max(1, msg.binning_y)
        roi = self.raw_roi = copy.copy(msg.roi)
        if not (roi.x_offset or roi.y_offset or roi.width or roi.height):  # the whole image
            roi.width, roi.height = self.resolution
        self.tf_frame, self.stamp = msg.header.frame_id, msg.header.stamp
        self.K, self.P = self.full_K.copy(), self.full_P.copy()
        for matrix in (self.K, self.P):
            matrix[:2, 2] -= [[roi.x_offset], [roi.y_offset]]
            for row, binning in enumerate((self.binning_x, self.binning_y)):
                matrix[row, [row, 2]] /= binning

    def rectifyImage(self, raw: Any, rectified: Any) -> None:
        """Write the pixels of the image `raw`, with the distortion removed, into the image `rectified`."""
        cv2 = _opencv()
        shape = self.height, self.width, 1
        self.mapx, self.mapy = np.ndarray(shape, np.float32), np.ndarray(shape, np.float32)
        size = self.width, self.height
        cv2.initUndistortRectifyMap(self.K, self.D, self.R, self.P, size, cv2.CV_32FC1, self.mapx, self.mapy)
        cv2.remap(raw, self.mapx, self.mapy, cv2.INTER_CUBIC, rectified)

    def rectifyPoint(self, uv_raw: Any) -> Any:
        """Return the position of a raw pixel in the rectified image: an array of u and v."""
        source = np.array([[[uv_raw[0], uv_raw[1]]]], np.float64)
        return _opencv().undistortPoints(source, self.K, self.D, R=self.R, P=self.P)[0, 0]

    def project3dToPixel(self, point: Any) -> Pair:
        """Return the rectified pixel (u, v) of a point (x, y, z) in the camera's frame; NaN for depth 0."""
        x, y, w = (self.P * mkmat(4, 1, [point[0], point[1], point[2], 1.0])).flat
        return (x / w, y / w) if w != 0 else (math.nan, math.nan)

    def projectPixelTo3dRay(self, uv: Any) -> Triple:
        """Return the direction (x, y, z), of length 1, from the camera to a rectified pixel (u, v)."""
        x, y = (uv[0] - self.cx()) / self.fx(), (uv[1] - self.cy()) / self.fy()
        norm = math.sqrt(x * x + y * y + 1)
        return x / norm, y / norm, 1.0 / norm

    def getDeltaU(self, deltaX: float, Z: float) -> float:
        """Return the horizontal distance in pixels of two points that are `deltaX` apart at depth `Z`."""
        return math.inf if Z == 0 else self.fx() * deltaX / Z

    def getDeltaV(self, deltaY: float, Z: float) -> float:
        """Return the vertical distance in pixels of two points that are `deltaY` apart at depth `Z`."""
        return math.inf if Z == 0 else self.fy() * deltaY / Z

    def getDeltaX(self, deltaU: float, Z: float) -> Any:
        """Return the horizontal distance in space, at depth `Z`, of two pixels that are `deltaU` apart."""
        return Z * deltaU / self.fx()

    def getDeltaY(self, deltaV: float, Z: float) -> Any:
        """Return the vertical distance in space, at depth `Z`, of two pixels that are `deltaV` apart."""
        return Z * deltaV / self.fy()

    def fullResolution(self) -> tuple[int, int]:
        """Return width and height of the full image in pixels; raise AttributeError before `fromCameraInfo`."""
        return self.resolution

    def intrinsicMatrix(self) -> Any:
        return self.K

    def distortionCoeffs(self) -> Any:
        return self.D

    def rotationMatrix(self) -> Any:
        return self.R

    def projectionMatrix(self) -> Any:
        return self.P

    def fullIntrinsicMatrix(self) -> Any:
        return self.full_K

    def fullProjectionMatrix(self) -> Any:
        return self.full_P

    cx = _entry(0, 2, "Return the column of the principal point.")
    cy = _entry(1, 2, "Return the row of the principal point.")
    fx = _entry(0, 0, "Return the focal length in pixel widths.")
    fy = _entry(1, 1, "Return the focal length in pixel heights.")
    Tx = _entry(0, 3, "Return the horizontal offset: minus focal length times base for a right camera.")
    Ty = _entry(1, 3, "Return the vertical offset of the projection.")

    def fovX(self) -> float:
        """Return the horizontal angle of view in radians."""
        return 2 * math.atan(self.width / (2 * self.fx()))

    def fovY(self) -> float:
        """Return the vertical angle of view in radians."""
        return 2 * math.atan(self.height / (2 * self.fy()))

    def tfFrame(self) -> Any:
        return self.tf_frame


class StereoCameraModel:
    """Model of two parallel cameras, `left` and `right`.

    Attributes:
        Q: 4 x 4 matrix that converts pixel and disparity to a point, set by `fromCameraInfo`.
    """

    def __init__(self) -> None:
        self.left = PinholeCameraModel()
        self.right = PinholeCameraModel()

    def fromCameraInfo(self, left_msg: Any, right_msg: Any) -> None:
        """Read the parameters of the ``sensor_msgs/msg/CameraInfo`` of both cameras."""
        self.left.fromCameraInfo(left_msg)
        self.right.fromCameraInfo(right_msg)
        fx, cx, cy = self.right.fx(), self.right.cx(), self.right.cy()
        self.Q = np.zeros((4, 4))
        self.Q[[0, 1], [0, 1]] = 1.0
        self.Q[:3, 3] = -cx, -cy, fx
        self.Q[3, 2] = 1 / (-self.right.Tx() / fx)

    def tfFrame(self) -> Any:
        """Return the frame of the left camera, to which points refer."""
        return self.left.tfFrame()

    def project3dToPixel(self, point: Any) -> tuple[Pair, Pair]:
        """Return the rectified pixels of a point in the left and the right image."""
        return self.left.project3dToPixel(point), self.right.project3dToPixel(point)

    def projectPixelTo3d(self, left_uv: Any, disparity: float) -> Triple:
        """Return the point for a rectified pixel of the left image and its disparity; (0, 0, 0) for disparity 0."""
        x, y, z, w = (self.Q * mkmat(4, 1, [left_uv[0], left_uv[1], disparity, 1.0])).flat
        return (x / w, y / w, z / w) if w != 0 else (0.0, 0.0, 0.0)

    def getZ(self, disparity: float) -> float:
        """Return the depth of a point whose disparity in pixels is given."""
        return math.inf if disparity == 0 else -self.right.Tx() / disparity

    def getDisparity(self, Z: float) -> float:
        """Return the disparity in pixels of a point at a depth."""
        return math.inf if Z == 0 else -self.right.Tx() / Z
