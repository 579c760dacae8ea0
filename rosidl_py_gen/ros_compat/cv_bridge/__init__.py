"""Conversion of image messages to arrays and back. OpenCV is optional; it is used for compressed images."""

from cv_bridge.boost.cv_bridge_boost import getCvType
from cv_bridge.core import CvBridge, CvBridgeError
