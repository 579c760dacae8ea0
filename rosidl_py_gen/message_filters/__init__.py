"""Filters that combine messages of several topics by their stamps: exact and approximate synchronizers, and a cache.

The synchronizers make the same sets of messages as the Python package message_filters of ROS 2.
"""

from rosidl_py_gen.message_filters.filters import ApproximateTimeSynchronizer as ApproximateTimeSynchronizer
from rosidl_py_gen.message_filters.filters import Cache as Cache
from rosidl_py_gen.message_filters.filters import MessageFilter as MessageFilter
from rosidl_py_gen.message_filters.filters import StampError as StampError
from rosidl_py_gen.message_filters.filters import Subscriber as Subscriber
from rosidl_py_gen.message_filters.filters import TimeSynchronizer as TimeSynchronizer
