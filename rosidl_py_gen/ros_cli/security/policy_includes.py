"""Reading of a policy file whose ``xi:include`` elements are replaced by the included elements.

An included file must be below the folder of the policy, also after symbolic links are resolved. The number of files
and of elements is limited, because a file that includes another one twice doubles the size with each level.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import unquote

from rosidl_py_gen.base.xml_reader import XmlElement, read_xml
from rosidl_py_gen.errors import display_path

if TYPE_CHECKING:
    from collections.abc import Iterable

_MAX_INCLUDES = 1000
"""Maximum number of ``xi:include`` elements in a policy; the standard includes of a ROS node are 4 for each profile."""
_MAX_ELEMENTS = 100_000
"""Maximum number of elements of a policy after includes, which is about 2000 nodes with 50 topics each."""
_MAX_INCLUDE_DEPTH = 16
_INCLUDE = re.compile(r"\{http://www\.w3\.org/200[13]/XInclude\}(\w+)")
_XPOINTER = re.compile(r"xpointer\(\s*((?:/(?:[A-Za-z_][\w.-]*|\*))+)\s*\)")
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


def read_policy_tree(path: str) -> XmlElement:
    """Read a policy file, expand its ``xi:include`` elements, and return the root. Raises `DefinitionError`."""
    return _Includes(os.path.realpath(os.path.dirname(path) or ".")).read(path)


@dataclass(slots=True)
class _Includes:
    """Expansion of the includes of one policy; included files must be below its folder, with links resolved."""

    folder: str
    includes: int = 0
    elements: int = 0

    def read(self, path: str) -> XmlElement:
        root = read_xml(path)
        self._count(root)
        if _INCLUDE.fullmatch(root.tag):
            raise root.error("the root element is an include; expected <policy> or a part of a policy")
        self._expand(root, self.folder, (os.path.realpath(path),))
        return root

    def _count(self, element: XmlElement) -> None:
        self.elements += 1
        if self.elements > _MAX_ELEMENTS:
            raise element.error(f"the policy has more than {_MAX_ELEMENTS} elements, included ones counted")
        for child in element.children:
            self._count(child)

    def _expand(self, element: XmlElement, folder: str, open_files: tuple[str, ...]) -> None:
        """Replace the include elements inside an element by the included elements.

        Each file in `open_files` includes the next one.
        """
        children: list[XmlElement] = []
        for child in element.children:
            if match := _INCLUDE.fullmatch(child.tag):
                children += self._included(child, match[1], folder, open_files)
            else:
                self._expand(child, folder, open_files)
                children.append(child)
        element.children = children

    def _included(
        self, include: XmlElement, name: str, folder: str, open_files: tuple[str, ...]
    ) -> Iterable[XmlElement]:
        if name != "include" or any(include.elements):
            raise include.error("xi:fallback is not supported: a missing file must not change permissions silently")
        self.includes += 1
        if self.includes > _MAX_INCLUDES:
            raise include.error(f"the policy has more than {_MAX_INCLUDES} includes")
        if len(open_files) > _MAX_INCLUDE_DEPTH:
            raise include.error(f"includes are nested more than {_MAX_INCLUDE_DEPTH} deep")
        unknown = sorted(include.attributes.keys() - {"href", "xpointer", "parse"})
        if unknown or include.attributes.get("parse", "xml") != "xml":
            found = unknown[0] if unknown else f"parse={include.attributes['parse']!r}"
            raise include.error(f"xi:include: got {found}; expected href, xpointer and parse='xml'")
        path = self._file(include, folder)
        if path in open_files:
            raise include.error(f"{display_path(path)} includes itself")
        pointer = include.attributes.get("xpointer")
        root = read_xml(path)
        self._count(root)
        self._expand(root, os.path.dirname(path), (*open_files, path))
        return [root] if pointer is None else _select(include, pointer, root)

    def _file(self, include: XmlElement, folder: str) -> str:
        href = include.attributes.get("href", "")
        if not href or "#" in href or "?" in href or "\0" in unquote(href) or _SCHEME.match(href):
            raise include.error(
                f"xi:include: got href={href!r:.200}; expected the path of a file below the folder of the policy"
            )
        path = os.path.realpath(os.path.join(folder, unquote(href)))
        if not _is_below(path, self.folder):
            raise include.error(
                f"xi:include: {href!r:.200} is {display_path(path)}, outside the folder of the policy; move the file "
                f"below {display_path(self.folder)}"
            )
        if not os.path.isfile(path):
            raise include.error(f"xi:include: {href!r:.200} is not a file; expected one at {display_path(path)}")
        return path


def _select(include: XmlElement, pointer: str, root: XmlElement) -> list[XmlElement]:
    match = _XPOINTER.fullmatch(pointer)
    if match is None:
        raise include.error(
            f"xi:include: got xpointer={pointer!r:.200}; expected a path of names, as xpointer(/policy/enclaves/*)"
        )
    found = [XmlElement("", children=[root])]
    for name in match[1].split("/")[1:]:
        found = [child for element in found for child in element.elements if name in ("*", child.tag)]
    if not found:
        raise include.error(f"xi:include: {match[1]} is not in {root.source.path}; its root element is <{root.tag}>")
    return found


def _is_below(path: str, folder: str) -> bool:
    try:
        return os.path.commonpath([folder, path]) == folder
    except ValueError:  # on another drive
        return False
