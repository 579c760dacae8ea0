"""Description of messages as JSON, run by the Python of a ROS installation and by ours with the import hook.

``describe_messages.py statements`` runs the programs on stdin, and prints the value of the last line or the error.
``describe_messages.py types`` describes all messages, services and actions of the packages on stdin.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module

if len(sys.argv) > 2:  # the folders of definitions: ours
    from rosidl_py_gen import install_import_hook

    install_import_hook(message_api="rclpy", path=[one for one in sys.argv[2].split(":") if one])


def outcome(program: str) -> str:
    """Return type and value of the last line of a program, or the error."""
    *lines, last = program.strip().split("\n")
    scope: dict[str, object] = {}
    try:
        exec("\n".join(lines), scope)
        value = eval(last, scope)
    except AssertionError as error:
        return f"AssertionError: {error}"
    except Exception as error:
        return type(error).__name__
    return f"{type(value).__module__}.{type(value).__qualname__} {value!r}"


def parts(value: object) -> object:
    """Describe an object of `SLOT_TYPES`, whose own repr has no contents."""
    bases = [one.__name__ for one in type(value).__mro__[:-1]]
    names = [name for one in type(value).__mro__ for name in _names(one)]
    found = {name: getattr(value, name) for name in sorted(names)}
    return [bases, {name: parts(one) if hasattr(type(one), "__slots__") else one for name, one in found.items()}]


def _names(cls: type) -> list[str]:
    slots = cls.__dict__.get("__slots__", ())
    return [slots] if isinstance(slots, str) else list(slots)


def about_message(cls: type) -> dict[str, object]:
    constants = {name: repr(getattr(cls, name)) for name in dir(cls) if name.isupper() and name != "SLOT_TYPES"}
    own = {name: value for name, value in constants.items() if not name.startswith("_")}
    try:
        shown = repr(cls())
    except Exception as error:
        shown = repr(error)
    return {
        "module": cls.__module__,
        "slots": cls.__slots__,
        "fields": list(cls.get_fields_and_field_types().items()),
        "types": [parts(one) for one in cls.SLOT_TYPES],
        "new": shown,
        "constants": own,
        "metaclass": type(cls).__name__,
        "values": {name: kind_of(cls(), name[1:]) for name in cls.__slots__ if name != "_check_fields"},
        "unhashable": cls.__hash__ is None,
        "equal": cls() == cls(),
    }


def kind_of(message: object, name: str) -> str:
    value = getattr(message, name)
    inside = f" of {type(value[0]).__name__}" if isinstance(value, list) and value else ""
    return f"{type(value).__name__}{inside} {getattr(value, 'typecode', '')} {getattr(value, 'dtype', '')}"


def about_packages(packages: list[str]) -> dict[str, object]:
    found: dict[str, object] = {}
    for package in packages:
        for kind in ("msg", "srv", "action"):
            try:
                module = import_module(f"{package}.{kind}")
            except ModuleNotFoundError:
                continue
            for name in sorted(name for name in dir(module) if name[:1].isupper()):
                cls = getattr(module, name)
                full = f"{package}/{kind}/{name}"
                if hasattr(cls, "get_fields_and_field_types"):
                    found[full] = about_message(cls)
                else:
                    names = ("Request", "Response", "Event", "Goal", "Result", "Feedback")
                    found[full] = {part: getattr(cls, part).__name__ for part in names if hasattr(cls, part)}
                    if hasattr(cls, "Impl"):
                        impl = {part: getattr(cls.Impl, part) for part in dir(cls.Impl) if part[0] != "_"}
                        found[full]["Impl"] = {part: f"{one.__module__}.{one.__name__}" for part, one in impl.items()}
    return found


if __name__ == "__main__":
    given = json.load(sys.stdin)
    json.dump([outcome(one) for one in given] if sys.argv[1] == "statements" else about_packages(given), sys.stdout)
