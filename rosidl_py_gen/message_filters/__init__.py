"""Messages of several topics that belong together by their stamps: exact and approximate synchronizers, and a cache.

Which messages make a set is as in the Python of ROS 2's message_filters.
"""

from rosidl_py_gen.message_filters.cache import Cache as Cache
from rosidl_py_gen.message_filters.filters import MessageFilter as MessageFilter
from rosidl_py_gen.message_filters.filters import Subscriber as Subscriber
from rosidl_py_gen.message_filters.stamps import StampError as StampError
from rosidl_py_gen.message_filters.synchronizers import ApproximateTimeSynchronizer as ApproximateTimeSynchronizer
from rosidl_py_gen.message_filters.synchronizers import TimeSynchronizer as TimeSynchronizer
