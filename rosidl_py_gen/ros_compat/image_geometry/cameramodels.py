"""Models of one camera and of two, made of ``sensor_msgs/msg/CameraInfo``.

Matrices are of `numpy.matrix`, as in the real package: ``*`` is their product. Before `fromCameraInfo` all is None.
"""

from __future__ import annotations

import copy
import math
from importlib import import_module
from typing import Any

import numpy as np

Matrix = np.matrix[Any, np.dtype[np.float64]]
Pair = tuple[float, float]
Triple = tuple[float, float, float]


def mkmat(rows: int, cols: int, L: Any) -> Matrix:
    """Numbers, row by row, as a matrix."""
    return np.matrix(np.reshape(np.asarray(L, np.float64), (rows, cols)))


def _opencv() -> Any:
    try:
        return import_module("cv2")
    except ModuleNotFoundError as error:
        text = "image_geometry rectifies with OpenCV, which is not installed (opencv-python-headless)"
        raise ModuleNotFoundError(text, name=error.name) from None


class PinholeCameraModel:
    """A camera without a lens that bends.

    Attributes:
        K: camera matrix, 3 x 3, of the binned region of interest.
        D: distortion coefficients, n x 1; None without.
        R: rectifying rotation, 3 x 3.
        P: projection, 3 x 4, of the binned region of interest.
        full_K: camera matrix of the full resolution.
        full_P: projection of the full resolution.
        width: of the full resolution, in pixels; so `height`.
        binning_x: pixels that are one of the image; so `binning_y`.
        raw_roi: the region of interest, a ``sensor_msgs/msg/RegionOfInterest``; never empty.
        tf_frame: the frame of the camera.
        stamp: the time of the CameraInfo.
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
        """Take the parameters of a ``sensor_msgs/msg/CameraInfo``."""
        self.full_K, self.full_P, self.R = mkmat(3, 3, msg.k), mkmat(3, 4, msg.p), mkmat(3, 3, msg.r)
        self.D = mkmat(len(msg.d), 1, msg.d) if len(msg.d) else None
        self.width, self.height = self.resolution = (msg.width, msg.height)
        self.binning_x, self.binning_y = max(1, msg.binning_x), max(1, msg.binning_y)
        roi = self.raw_roi = copy.copy(msg.roi)
        if not (roi.x_offset or roi.y_offset or roi.width or roi.height):  # which means all
            roi.width, roi.height = self.resolution
        self.tf_frame, self.stamp = msg.header.frame_id, msg.header.stamp
        self.K, self.P = self.full_K.copy(), self.full_P.copy()
        for matrix in (self.K, self.P):
            matrix[:2, 2] -= [[roi.x_offset], [roi.y_offset]]
            for row, binning in enumerate((self.binning_x, self.binning_y)):
                matrix[row, [row, 2]] /= binning

    # --- rectifying ---------------------------------------------------------------------------------------------------

    def rectifyImage(self, raw: Any, rectified: Any) -> None:
        """Write the pixels of `raw` as they would be without distortion into `rectified`."""
        cv2 = _opencv()
        shape = self.height, self.width, 1
        self.mapx, self.mapy = np.ndarray(shape, np.float32), np.ndarray(shape, np.float32)
        size = self.width, self.height
        cv2.initUndistortRectifyMap(self.K, self.D, self.R, self.P, size, cv2.CV_32FC1, self.mapx, self.mapy)
        cv2.remap(raw, self.mapx, self.mapy, cv2.INTER_CUBIC, rectified)

    def rectifyPoint(self, uv_raw: Any) -> Any:
        """Where a pixel of the raw image is in the rectified one: an array of u and v."""
        source = np.array([[[uv_raw[0], uv_raw[1]]]], np.float64)
        return _opencv().undistortPoints(source, self.K, self.D, R=self.R, P=self.P)[0, 0]

    # --- pixels and points --------------------------------------------------------------------------------------------

    def project3dToPixel(self, point: Any) -> Pair:
        """The rectified pixel (u, v) of a point (x, y, z) in the frame of the camera; NaN in its plane."""
        x, y, w = (self.P * mkmat(4, 1, [point[0], point[1], point[2], 1.0])).flat
        return (x / w, y / w) if w != 0 else (math.nan, math.nan)

    def projectPixelTo3dRay(self, uv: Any) -> Triple:
        """The direction (x, y, z), of length 1, in which a rectified pixel is seen."""
        x, y = (uv[0] - self.cx()) / self.fx(), (uv[1] - self.cy()) / self.fy()
        norm = math.sqrt(x * x + y * y + 1)
        return x / norm, y / norm, 1.0 / norm

    def getDeltaU(self, deltaX: float, Z: float) -> float:
        """Pixels to the right that are `deltaX` at depth `Z`."""
        return math.inf if Z == 0 else self.fx() * deltaX / Z

    def getDeltaV(self, deltaY: float, Z: float) -> float:
        """Pixels down that are `deltaY` at depth `Z`."""
        return math.inf if Z == 0 else self.fy() * deltaY / Z

    def getDeltaX(self, deltaU: float, Z: float) -> Any:
        """How far `deltaU` pixels to the right are at depth `Z`."""
        return Z * deltaU / self.fx()

    def getDeltaY(self, deltaV: float, Z: float) -> Any:
        """How far `deltaV` pixels down are at depth `Z`."""
        return Z * deltaV / self.fy()

    # --- parameters ---------------------------------------------------------------------------------------------------

    def fullResolution(self) -> tuple[int, int]:
        """Width and height in pixels; AttributeError before `fromCameraInfo`."""
        return self.resolution

    def intrinsicMatrix(self) -> Any:
        """`K`."""
        return self.K

    def distortionCoeffs(self) -> Any:
        """`D`."""
        return self.D

    def rotationMatrix(self) -> Any:
        """`R`."""
        return self.R

    def projectionMatrix(self) -> Any:
        """`P`."""
        return self.P

    def fullIntrinsicMatrix(self) -> Any:
        """`full_K`."""
        return self.full_K

    def fullProjectionMatrix(self) -> Any:
        """`full_P`."""
        return self.full_P

    def cx(self) -> Any:
        """Column of the centre."""
        return self.P[0, 2]

    def cy(self) -> Any:
        """Row of the centre."""
        return self.P[1, 2]

    def fx(self) -> Any:
        """Focal length in widths of pixels."""
        return self.P[0, 0]

    def fy(self) -> Any:
        """Focal length in heights of pixels."""
        return self.P[1, 1]

    def Tx(self) -> Any:
        """What the projection moves to the right: of the right one of two cameras, minus focal length times base."""
        return self.P[0, 3]

    def Ty(self) -> Any:
        """What the projection moves down."""
        return self.P[1, 3]

    def fovX(self) -> float:
        """Angle of view from left to right, in radians."""
        return 2 * math.atan(self.width / (2 * self.fx()))

    def fovY(self) -> float:
        """Angle of view from top to bottom, in radians."""
        return 2 * math.atan(self.height / (2 * self.fy()))

    def tfFrame(self) -> Any:
        """`tf_frame`."""
        return self.tf_frame


class StereoCameraModel:
    """Two cameras beside each other, `left` and `right`.

    Attributes:
        Q: 4 x 4, makes a point of pixel and disparity; there after `fromCameraInfo`.
    """

    def __init__(self) -> None:
        self.left = PinholeCameraModel()
        self.right = PinholeCameraModel()

    def fromCameraInfo(self, left_msg: Any, right_msg: Any) -> None:
        """Take the parameters of two ``sensor_msgs/msg/CameraInfo``."""
        self.left.fromCameraInfo(left_msg)
        self.right.fromCameraInfo(right_msg)
        fx, cx, cy = self.right.fx(), self.right.cx(), self.right.cy()
        self.Q = np.zeros((4, 4))
        self.Q[[0, 1], [0, 1]] = 1.0
        self.Q[:3, 3] = -cx, -cy, fx
        self.Q[3, 2] = 1 / (-self.right.Tx() / fx)

    def tfFrame(self) -> Any:
        """The frame of the left camera, which points are in."""
        return self.left.tfFrame()

    def project3dToPixel(self, point: Any) -> tuple[Pair, Pair]:
        """The rectified pixels of a point, in the left and the right image."""
        return self.left.project3dToPixel(point), self.right.project3dToPixel(point)

    def projectPixelTo3d(self, left_uv: Any, disparity: float) -> Triple:
        """The point of a rectified pixel of the left image; (0, 0, 0) for disparity 0, which is infinitely far."""
        x, y, z, w = (self.Q * mkmat(4, 1, [left_uv[0], left_uv[1], disparity, 1.0])).flat
        return (x / w, y / w, z / w) if w != 0 else (0.0, 0.0, 0.0)

    def getZ(self, disparity: float) -> float:
        """The depth that `disparity` pixels mean."""
        return math.inf if disparity == 0 else -self.right.Tx() / disparity

    def getDisparity(self, Z: float) -> float:
        """The disparity, in pixels, at a depth."""
        return math.inf if Z == 0 else -self.right.Tx() / Z
