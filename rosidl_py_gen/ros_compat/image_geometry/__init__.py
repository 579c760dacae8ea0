"""Pixels of calibrated cameras and their positions in space; only rectification needs OpenCV."""

from image_geometry.cameramodels import PinholeCameraModel as PinholeCameraModel
from image_geometry.cameramodels import StereoCameraModel as StereoCameraModel
