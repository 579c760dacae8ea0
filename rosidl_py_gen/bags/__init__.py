"""Bags: recorded messages as MCAP files and rosbag2 folders, read and written without ROS.

Needs the extra ``mcap``; without it the import raises `ExtraMissingError`, an `ImportError` that has the command.
"""

from rosidl_py_gen.base.resources import missing_extra_message as _extra_missing

try:
    from rosidl_py_gen.bags.common import BagError as BagError
    from rosidl_py_gen.bags.common import BagMessage as BagMessage
    from rosidl_py_gen.bags.common import BagTopic as BagTopic
    from rosidl_py_gen.bags.common import BagWarning as BagWarning
    from rosidl_py_gen.bags.common import DamagedPart as DamagedPart
    from rosidl_py_gen.bags.common import RawMessage as RawMessage
    from rosidl_py_gen.bags.common import SkippedMessages as SkippedMessages
    from rosidl_py_gen.bags.definition_lookup import DecoderFactory as DecoderFactory
    from rosidl_py_gen.bags.definition_lookup import TopicDefinition as TopicDefinition
    from rosidl_py_gen.bags.reader import BagReader as BagReader
    from rosidl_py_gen.bags.writer import BagWriter as BagWriter
    from rosidl_py_gen.bags.writer import SqliteWriter as SqliteWriter
except ModuleNotFoundError as missing:
    raise _extra_missing(missing) or missing from None
