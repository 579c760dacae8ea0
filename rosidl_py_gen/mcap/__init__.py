"""Bags: recorded messages as MCAP files and rosbag2 folders, read and written without ROS.

Needs the extra: ``pip install 'rosidl-py-gen[mcap]'``.
"""

from rosidl_py_gen.mcap.common import BagError as BagError
from rosidl_py_gen.mcap.common import BagMessage as BagMessage
from rosidl_py_gen.mcap.common import BagTopic as BagTopic
from rosidl_py_gen.mcap.common import BagWarning as BagWarning
from rosidl_py_gen.mcap.common import LeftOut as LeftOut
from rosidl_py_gen.mcap.common import RawMessage as RawMessage
from rosidl_py_gen.mcap.decoder import DecoderFactory as DecoderFactory
from rosidl_py_gen.mcap.reader import BagReader as BagReader
from rosidl_py_gen.mcap.sqlite import SqliteWriter as SqliteWriter
from rosidl_py_gen.mcap.writer import BagWriter as BagWriter
