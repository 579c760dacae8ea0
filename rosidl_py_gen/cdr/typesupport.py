"""What can be asked of a generated class: name, hash, description.

Works on classes and instances of messages, and on service and action classes. Imports neither compiler nor runtime.
"""

from __future__ import annotations

from rosidl_py_gen.base.descriptions import Description, FieldRow, action_rows, build_type_description, service_rows
from rosidl_py_gen.cdr.message import Action, Message, Service
from rosidl_py_gen.errors import TypeNotFoundError

_PARTS = {
    Service: ("Request", "Response", "Event"),
    Action: ("Goal", "Result", "Feedback", "FeedbackMessage", "SendGoal", "GetResult"),
}


def _info(subject: object) -> tuple[type, str, str]:
    cls = subject if isinstance(subject, type) else type(subject)
    info = cls.__dict__.get("_TYPE") or getattr(cls, "_TYPE", None)
    if info is None or not issubclass(cls, (Message, Service, Action)):
        raise TypeNotFoundError(f"expected a generated message, service or action, found {subject!r:.100}")
    return cls, info.name, info.hash


def type_name(subject: object) -> str:
    """``std_msgs/msg/String`` of a class or instance.

    Raises:
        TypeNotFoundError: not a generated class.
    """
    return _info(subject)[1]


def type_hash(subject: object) -> str:
    """RIHS01 hash of a class or instance, ``RIHS01_`` and 64 hexadecimal digits.

    Raises:
        TypeNotFoundError: not a generated class.

    Source: docs/internals/protocol.md 3.
    """
    return _info(subject)[2]


def type_description(subject: object) -> Description:
    """The type description of a class or instance, as rosidl writes it to JSON.

    Returns:
        ``type_description`` and ``referenced_type_descriptions``; the keys are those of
        type_description_interfaces/msg/TypeDescription, so `from_dict` turns it into that message.

    Raises:
        TypeNotFoundError: not a generated class.
    """
    _, name, _ = _info(subject)
    classes = referenced_classes(subject)

    def rows(full_name: str) -> list[FieldRow]:
        found = classes[full_name]
        if issubclass(found, Message):
            info = found._TYPE
            return [(field.ros_name, field.type, info.defaults.get(field.ros_name, "")) for field in info.fields]
        return list(service_rows(full_name) if issubclass(found, Service) else action_rows(full_name))

    return build_type_description(name, rows)


def referenced_classes(subject: object) -> dict[str, type]:
    """The class itself and every class its fields or parts lead to, by type name."""
    found: dict[str, type] = {}
    pending = [_info(subject)[0]]
    while pending:
        one = pending.pop()
        name = _info(one)[1]
        if name not in found:
            found[name] = one
            pending += _referenced(one)
    return found


def hashes_of(subject: object) -> dict[str, str]:
    """RIHS01 hash of the class itself and of every class it leads to, by type name."""
    return {name: type_hash(cls) for name, cls in referenced_classes(subject).items()}


def constants(cls: type) -> dict[str, bool | int | float | str]:
    """The constants of a generated class by name."""
    annotations: dict[str, object] = getattr(cls, "__annotations__", {})
    # The annotation of a field shows the same word when its type is called so; what the class holds for it is no value.
    held = {name: getattr(cls, name) for name, kind in annotations.items() if "ClassVar" in str(kind)}
    return {name: value for name, value in held.items() if isinstance(value, (bool, int, float, str))}


def _referenced(cls: type) -> list[type]:
    if issubclass(cls, Message):
        return [field.cls for field in cls._TYPE.fields if field.cls is not None]
    base = Service if issubclass(cls, Service) else Action
    return [getattr(cls, part) for part in _PARTS[base]]
