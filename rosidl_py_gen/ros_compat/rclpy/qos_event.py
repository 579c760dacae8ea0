"""Module with the deprecated name of `rclpy.event_handler`."""

import warnings
from enum import IntEnum
from typing import List, Optional

from rclpy.event_handler import *

warnings.warn("importing 'qos_event' is deprecated; import 'event_handler' instead", stacklevel=2)
