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

# isort: split
# For the other packages of rosidl_py_gen; not public.
from rosidl_py_gen.bags.common import DurableFile as DurableFile
from rosidl_py_gen.bags.definition_lookup import described as described
from rosidl_py_gen.bags.definition_lookup import mismatch_reason as mismatch_reason
from rosidl_py_gen.bags.metadata import OfferedQoS as OfferedQoS
from rosidl_py_gen.bags.remote import BagLocation as BagLocation
from rosidl_py_gen.bags.rewriting import BagCopy as BagCopy
from rosidl_py_gen.bags.rewriting import SourceBag as SourceBag
from rosidl_py_gen.bags.rewriting import reindex as reindex
from rosidl_py_gen.bags.storage.storage_api import MessageBlock as MessageBlock
from rosidl_py_gen.bags.storage.storage_api import RawTuple as RawTuple
from rosidl_py_gen.bags.writer import topic_of as topic_of
