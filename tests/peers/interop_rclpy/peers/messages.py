"""Conversion of rclpy messages to plain JSON values and back, in the format of our `to_json`.

Keys are ROS names, bytes are numbers, NaN and the infinities are texts. Long byte arrays are transferred as size and
seed (to the peer, see `random_bytes`) and as a digest (from the peer).
"""

import hashlib
import importlib
import math
import random

from rosidl_parser.definition import AbstractNestedType, BasicType, NamespacedType

SPECIAL = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
LONG = 4096


def load(name):
    """Return the class of ``std_msgs/msg/String``, or ``std_srvs/srv/SetBool_Event``."""
    package, kind, short = name.split("/")
    outer, _, inner = short.partition("_")
    cls = getattr(importlib.import_module(f"{package}.{kind}"), outer)
    return getattr(cls, inner) if inner else cls


def random_bytes(size, seed):
    return random.Random(seed).randbytes(size)


def to_plain(value):
    if hasattr(value, "get_fields_and_field_types"):
        return {name: to_plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):  # a byte field
        return value[0]
    if isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return next((text for text, number in SPECIAL.items() if repr(number) == repr(value)), value)
    if hasattr(value, "item") and not getattr(value, "shape", (1,)):
        return to_plain(value.item())
    if getattr(value, "typecode", "") == "B" and len(value) > LONG:
        return {"size": len(value), "sha256": hashlib.sha256(value.tobytes()).hexdigest()}
    return [to_plain(item) for item in (value.tolist() if hasattr(value, "tolist") else value)]


def build(cls, values):
    """Create a message; missing fields keep their defaults."""
    message = cls()
    names = list(cls.get_fields_and_field_types())
    for name, item in values.items():
        setattr(message, name, _value(cls.SLOT_TYPES[names.index(name)], item))
    return message


def _value(kind, value):
    if isinstance(kind, AbstractNestedType):
        if isinstance(value, dict):
            return list(random_bytes(value["random_bytes"], value["seed"]))
        return [_value(kind.value_type, item) for item in value]
    if isinstance(kind, NamespacedType):
        return build(load("/".join(kind.namespaced_name())), value)
    if isinstance(kind, BasicType) and kind.typename == "octet":
        return bytes([value])
    if isinstance(kind, BasicType) and kind.typename in ("float", "double"):
        return SPECIAL.get(value, value)
    return value
