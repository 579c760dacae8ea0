"""Deprecated: the old name of `rosidl_py_gen.bags`, which has the same names. Version 1.0 removes it."""

import warnings as _warnings

from rosidl_py_gen.bags import BagError as BagError
from rosidl_py_gen.bags import BagMessage as BagMessage
from rosidl_py_gen.bags import BagReader as BagReader
from rosidl_py_gen.bags import BagTopic as BagTopic
from rosidl_py_gen.bags import BagWarning as BagWarning
from rosidl_py_gen.bags import BagWriter as BagWriter
from rosidl_py_gen.bags import DamagedPart as DamagedPart
from rosidl_py_gen.bags import DecoderFactory as DecoderFactory
from rosidl_py_gen.bags import LeftOut as LeftOut
from rosidl_py_gen.bags import RawMessage as RawMessage
from rosidl_py_gen.bags import SqliteWriter as SqliteWriter
from rosidl_py_gen.bags import TopicDefinition as TopicDefinition

_warnings.warn(
    "rosidl_py_gen.mcap is deprecated: import rosidl_py_gen.bags, which has the same names; version 1.0 removes this",
    DeprecationWarning,
    stacklevel=2,
)
