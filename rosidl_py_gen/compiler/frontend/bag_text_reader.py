"""Registry of the definitions in the text of a bag or MCAP file, which has a definition and the types that it uses.

`definition_text` writes such texts. Bags of other tools may contain any text, so each problem is an error with a
location.
"""

from __future__ import annotations

import re
from itertools import pairwise

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.interface_parser import separators
from rosidl_py_gen.compiler.frontend.model import SourceText
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.errors import DefinitionError, Diagnostic, InvalidNameError

_SEPARATOR = re.compile(r"^=+[ \t]*$")
_PART_NAME = re.compile(r"^(MSG|IDL|SRV):\s*(\S+)\s*$")


def registry_from_text(top: RosName, text: str, search: SearchPath) -> InterfaceRegistry:
    """Return a checked registry with the definitions of a text; `compile_definition` describes the format.

    Args:
        top: name of the first definition, whose kind selects the parser.
        text: the text.
        search: search path of the types that the text lacks.

    Raises:
        DefinitionError: the text has problems, located as ``<name>:line:column``.
    """
    names: list[RosName] = []
    registry = InterfaceRegistry(SearchPath(search.packages, [], ["the text", *search.searched]))
    for part, body, is_idl in _parts(top, text):
        owner, kind = _text_owner(part, body, is_idl)
        registry.add_text(owner, SourceText(f"<{part}>", body, kind))
        names.append(owner)
    check(registry, names)
    registry.raise_diagnostics()
    if registry.owner(top) is None or not registry.knows(str(top)):
        raise DefinitionError(Diagnostic(f"<{top}>", 0, 0, f"the text does not define {top}"))
    return registry


def _text_owner(name: RosName, text: str, is_idl: bool) -> tuple[RosName, str]:
    """Return the interface that a definition text of a bag for the type `name` defines, and the format of the text.

    The text for a derived type (``X_Event``, ``A_FeedbackMessage``) is either the text of the service or action, or the
    text of the derived message. The number of separators shows which.
    """
    if is_idl:
        return name, "idl"
    if separators(text) != {"msg": 0, "srv": 1, "action": 2}[name.kind]:
        plain = separators(text) == 0 and "_" in name.name
        return name, "msg" if plain else name.kind
    if name.kind == "msg" or "_" not in name.name:
        return name, name.kind
    return name._replace(name=name.name.split("_")[0]), name.kind


def _parts(top: RosName, text: str) -> list[tuple[RosName, str, bool]]:
    """Return the definitions in a concatenated text as tuples of name, text, and True for IDL.

    The first has the name `top`. Raises `DefinitionError` for an invalid name. Locations count from the first line of
    each definition.
    """
    lines = text.splitlines()
    cuts = [
        index
        for index, line in enumerate(lines[:-1])
        if len(line) >= 8 and _SEPARATOR.match(line) and _PART_NAME.match(lines[index + 1])
    ]
    bounds = [*cuts, len(lines)]
    first = lines[: bounds[0]]
    is_idl = any(re.match(r"\s*(module\s+\w+\s*\{|#include\b)", line) for line in first)
    if cuts and cuts[0] == 0:
        first = []
    parts = [(top, "\n".join(first), is_idl)] if first or not cuts else []
    for start, end in pairwise(bounds):
        found = _PART_NAME.match(lines[start + 1])
        assert found is not None
        try:
            part = RosName.parse(found[2], "msg")
        except InvalidNameError as error:
            problem = Diagnostic(f"<{top}>", start + 2, 1, str(error), lines[start + 1])
            raise DefinitionError(problem) from error
        parts.append((part, "\n".join(lines[start + 2 : end]), found[1] == "IDL"))
    return parts
