"""Conversion between pixels of calibrated cameras and positions in space; only rectification needs OpenCV."""

from image_geometry.cameramodels import PinholeCameraModel, StereoCameraModel
