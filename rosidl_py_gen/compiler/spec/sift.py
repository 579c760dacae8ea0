"""What of a selection can still be generated when some of it is wrong.

An interface is left out when its own file has problems, or when it needs one that is left out; the latter gets a
problem of its own that names the cause.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from rosidl_py_gen.base.names import split_ros_name
from rosidl_py_gen.compiler.spec.model import messages_of
from rosidl_py_gen.compiler.spec.resolve import type_location
from rosidl_py_gen.errors import Problem, shown_path

if TYPE_CHECKING:
    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.spec.model import FieldDef
    from rosidl_py_gen.compiler.spec.resolve import Library


def sift(library: Library, names: list[RosName]) -> tuple[list[RosName], list[Problem]]:
    """Tell the right interfaces from the wrong ones.

    Args:
        library: its findings say what is wrong; `check` has been over the names.
        names: a selection that has all it depends on.

    Returns:
        The interfaces that can be generated, in the order given, and a problem for each that cannot only because of
        another one.
    """
    wrong = _with_problems(library, names)
    if not wrong:
        return names, []
    causes = {name: name for name in wrong}  # what is left out -> what is wrong in the first place
    users: dict[RosName, list[tuple[RosName, FieldDef]]] = {}
    for name in names:
        for item in _references(library, name):
            need = split_ros_name(item.type.base)
            users.setdefault(library.owner(need) or need, []).append((name, item))
    problems: list[Problem] = []
    waiting = list(wrong)
    for gone in waiting:  # grows while it is gone through
        for user, item in users.get(gone, ()):
            if user not in causes:
                causes[user] = causes[gone]
                text = f"{user} needs {causes[gone]}, which has problems"
                problems.append(type_location(item).problem(text))
                waiting.append(user)
    return [name for name in names if name not in causes], problems


def _with_problems(library: Library, names: list[RosName]) -> list[RosName]:
    paths = {problem.path for problem in library.findings.problems}
    files = ((name, library.search.file(name)) for name in names)
    return [name for name, file in files if library.interface(name) is None or (file and shown_path(file) in paths)]


def _references(library: Library, name: RosName) -> list[FieldDef]:
    interface = library.interface(name)
    if interface is None:
        return []
    own = {str(message.name) for message in messages_of(interface)}
    fields = (item for message in messages_of(interface) for item in message.fields)
    return [item for item in fields if item.type.is_message and item.type.base not in own]
