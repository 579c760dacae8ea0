"""Images as arrays and back, without OpenCV; where that is installed, it reads and writes compressed ones."""

from cv_bridge.boost.cv_bridge_boost import getCvType as getCvType
from cv_bridge.core import CvBridge as CvBridge
from cv_bridge.core import CvBridgeError as CvBridgeError
