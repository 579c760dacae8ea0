"""Deprecated name of `rclpy.event_handler`."""

import warnings
from enum import IntEnum  # noqa: F401
from typing import List, Optional  # noqa: F401, UP035

from rclpy.event_handler import *  # noqa: F403

warnings.warn("importing 'qos_event' is deprecated; import 'event_handler' instead", stacklevel=2)
