"""The opaque type that stands for every ROS type towards Cyclone DDS.

Cyclone's Python layer wants a complete XTypes description of each topic type. Two ways were measured (cyclonedds
11.0.1, CPython 3.11, one machine):

| | true description | opaque description |
|---|---|---|
| build, PointCloud2-sized type | 3.0 ms | 0.02 ms (0.6 ms through cyclonedds.idl) |
| create the topic | 0.23 ms | 0.07 ms |
| write + take, 100 kB sample | 4.8 us | 4.7 us |
| wstring fields | no such type in cyclonedds.idl | irrelevant |
| a sample the C normalizer dislikes (bool 2, missing NUL) | dropped silently in C | arrives; we count and log it |
| big-endian writer | swapped by C | must be known from discovery, see below |
| `cyclonedds` tools (ls, typeof, subscribe) | show the fields | know the names only, as of other ROS endpoints |

Decision: opaque, and told to nobody (`topics.py`): peers compare names, as they do with ROS endpoints of
rmw_cyclonedds. The price is the row about byte order. It is paid in `graph/discovery.py`: a ROS participant's graph
message tells its byte order, and samples of big-endian participants get a header that says so, because Cyclone
rewrites the header as if it had swapped the data.

Versions of this library up to 0.1.0 announced it, and were compared by it among themselves. They match ours by name.
The member's name, derived from the type's name, keeps types apart inside Cyclone.

Source: protocol.md 11.1, 11.2. The bytes are XCDR2 little endian, as in DDS-XTypes 1.3, annex B.
"""

from __future__ import annotations

import hashlib
import struct


def member_name(dds_type: str) -> str:
    """``std_msgs::msg::dds_::String_`` -> ``std_msgs__msg__String``; another shape keeps its letters and digits."""
    plain = dds_type.replace("::dds_::", "::").removesuffix("_").replace("::", "__")
    return "".join(letter if letter.isalnum() else "_" for letter in plain)


def type_blobs(member: str) -> tuple[bytes, bytes]:
    """TypeInformation and TypeMapping of ``struct opaque { octet <member>; }``, a final struct."""
    name = member.encode()
    minimal = _delimited(_minimal_object(name))
    complete = _delimited(_complete_object(name))
    minimal_id = b"\xf1" + hashlib.md5(minimal, usedforsecurity=False).digest()[:14]
    complete_id = b"\xf2" + hashlib.md5(complete, usedforsecurity=False).digest()[:14]
    information = _with_dependencies(_MINIMAL_MEMBER, minimal_id, len(minimal))
    information += _with_dependencies(_COMPLETE_MEMBER, complete_id, len(complete))
    mapping = _padded(_delimited(_ONE + minimal_id + b"\0" + minimal))
    mapping += _padded(_delimited(_ONE + complete_id + b"\0" + complete))
    mapping += _delimited(_ONE + complete_id + minimal_id)
    return _delimited(information), mapping


_ONE = b"\1\0\0\0"
_FINAL = b"\1\0"
_STRUCTURE, _OCTET = b"\x51", 0x0D
_MINIMAL_MEMBER, _COMPLETE_MEMBER = 0x40001001, 0x40001002
"""Member headers of TypeInformation: ids 0x1001 and 0x1002, a length follows."""


def _delimited(body: bytes) -> bytes:
    return struct.pack("<I", len(body)) + body


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _minimal_object(name: bytes) -> bytes:
    """Members are known by the first four bytes of the MD5 of their name."""
    name_hash = hashlib.md5(name, usedforsecurity=False).digest()[:4]
    member = struct.pack("<IHB", 0, 1, _OCTET) + name_hash
    return b"\xf1" + _STRUCTURE + _FINAL + _delimited(b"\0") + b"\0\0\0" + _delimited(_ONE + _delimited(member))


def _complete_object(name: bytes) -> bytes:
    """Members carry their name, followed by two absent annotation lists (one octet each)."""
    header = b"\0\0\0\0" + _delimited(b"opaque\0")
    member = struct.pack("<IHBx", 0, 1, _OCTET) + _delimited(name + b"\0") + b"\0\0"
    members = _delimited(_ONE + _delimited(member))
    return b"\xf2" + _STRUCTURE + _FINAL + _padded(_delimited(header)) + members


def _with_dependencies(member_header: int, type_id: bytes, size: int) -> bytes:
    """TypeIdentifierWithDependencies: the id, the size of its object, no dependencies."""
    identified = _delimited(type_id + b"\0" + struct.pack("<I", size))
    body = _delimited(identified + struct.pack("<iII", 0, 4, 0))
    return struct.pack("<II", member_header, len(body)) + body
