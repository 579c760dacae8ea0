"""Pixels of calibrated cameras and where they are in space; OpenCV is needed only where images are rectified."""

from image_geometry.cameramodels import PinholeCameraModel as PinholeCameraModel
from image_geometry.cameramodels import StereoCameraModel as StereoCameraModel
