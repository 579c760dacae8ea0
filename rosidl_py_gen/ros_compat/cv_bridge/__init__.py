"""Conversion of images to arrays and back; OpenCV is optional, and converts compressed images."""

from cv_bridge.boost.cv_bridge_boost import getCvType
from cv_bridge.core import CvBridge, CvBridgeError
