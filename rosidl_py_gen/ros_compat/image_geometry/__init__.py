"""Pixels of calibrated cameras and their positions in space; only rectification needs OpenCV."""

from image_geometry.cameramodels import PinholeCameraModel, StereoCameraModel
