"""Functions that return the ROS name, hash, description and constants of a generated class or instance."""

from __future__ import annotations

from rosidl_py_gen.base.descriptions import Description, FieldRow, TypeDescriptions
from rosidl_py_gen.cdr.message import NESTED_CLASSES, Action, Message, Service
from rosidl_py_gen.errors import TypeNotFoundError


def _info(subject: object) -> tuple[type, str, str]:
    cls = subject if isinstance(subject, type) else type(subject)
    info = cls.__dict__.get("_TYPE") or getattr(cls, "_TYPE", None)
    if info is None or not issubclass(cls, (Message, Service, Action)):
        raise TypeNotFoundError(f"expected a generated message, service or action, found {subject!r:.100}")
    return cls, info.name, info.hash


def type_name(subject: object) -> str:
    """Return the ROS name of a generated class or its instance, such as ``std_msgs/msg/String``.

    Raises:
        TypeNotFoundError: the argument is not a generated class or an instance of one.
    """
    return _info(subject)[1]


def type_hash(subject: object) -> str:
    """Return the RIHS01 hash of a generated class or its instance: ``RIHS01_`` and 64 hexadecimal digits.

    Raises:
        TypeNotFoundError: the argument is not a generated class or an instance of one.
    """
    # Source: docs/internals/protocol.md 3.
    return _info(subject)[2]


def type_description(subject: object) -> Description:
    """Return the type description of a generated class or its instance, as rosidl writes it to JSON.

    Returns:
        ``type_description`` and ``referenced_type_descriptions``; the keys are the field names of
        type_description_interfaces/msg/TypeDescription, so `from_dict` makes that message.

    Raises:
        TypeNotFoundError: the argument is not a generated class or an instance of one.
    """
    _, name, _ = _info(subject)
    classes = referenced_classes(subject)

    def rows(full_name: str) -> list[FieldRow]:
        cls = classes[full_name]
        if issubclass(cls, Message):
            info = cls._TYPE
            return [(field.ros_name, field.type, info.defaults.get(field.ros_name, "")) for field in info.fields]
        is_service = issubclass(cls, Service)
        of_parts = TypeDescriptions.service_rows if is_service else TypeDescriptions.action_rows
        return list(of_parts(full_name))

    return TypeDescriptions(rows).of(name)


def referenced_classes(subject: object) -> dict[str, type]:
    """Return a generated class and the classes of its fields, at any depth, by type name."""
    classes: dict[str, type] = {}
    pending = [_info(subject)[0]]
    while pending:
        cls = pending.pop()
        name = _info(cls)[1]
        if name not in classes:
            classes[name] = cls
            if issubclass(cls, Message):
                pending += [field.cls for field in cls._TYPE.fields if field.cls is not None]
            else:
                names = NESTED_CLASSES["Service" if issubclass(cls, Service) else "Action"]
                pending += [getattr(cls, name) for name in names]
    return classes


def hashes_of(subject: object) -> dict[str, str]:
    """Return the RIHS01 hashes of a generated class and the classes of its fields, at any depth, by type name."""
    return {name: type_hash(cls) for name, cls in referenced_classes(subject).items()}


def constants(cls: type) -> dict[str, bool | int | float | str]:
    """Return the constants of a generated class by name."""
    annotations: dict[str, object] = getattr(cls, "__annotations__", {})
    # The type of a field may be called ClassVar as well; its class attribute is not a plain value.
    values = {name: getattr(cls, name) for name, kind in annotations.items() if "ClassVar" in str(kind)}
    return {name: value for name, value in values.items() if isinstance(value, (bool, int, float, str))}
