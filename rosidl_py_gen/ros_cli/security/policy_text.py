"""Writing a policy as XML: sorted and without repeated names, so that versions can be compared line by line."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from rosidl_py_gen.base.xml_reader import COMMENT, escape
from rosidl_py_gen.ros_cli.security.policy import RULES

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rosidl_py_gen.base.xml_reader import XmlElement

_NAMES = frozenset(tag for tag, _ in RULES.values())
_CLARK_NAME = re.compile(r"\{([^}]*)\}(.*)", re.DOTALL)
_XML = "http://www.w3.org/XML/1998/namespace"


def policy_text(root: XmlElement) -> str:
    """Return the XML of a policy. The order of metadata is kept."""
    return "\n".join(_lines(root, "", "", is_sorted=True)) + "\n"


def _lines(element: XmlElement, indent: str, default_namespace: str, *, is_sorted: bool) -> Iterable[str]:
    if element.tag == COMMENT:
        yield f"{indent}<!--{element.text}-->"
        return
    is_sorted = is_sorted and element.tag != "metadata"
    match = _CLARK_NAME.fullmatch(element.tag)
    namespace, tag = match.groups() if match else ("", element.tag)
    start = f"{indent}<{tag}"
    if namespace != default_namespace:
        start += f' xmlns="{escape(namespace, is_attribute=True)}"'
    start += "".join(_attributes(element))
    children = _sorted(element.children) if is_sorted else element.children
    text = escape(element.text.strip())
    if not children:
        yield f"{start}>{text}</{tag}>" if text else f"{start}/>"
        return
    yield f"{start}>{text}"
    for child in children:
        yield from _lines(child, f"{indent}  ", namespace, is_sorted=is_sorted)
    yield f"{indent}</{tag}>"


def _attributes(element: XmlElement) -> Iterable[str]:
    for number, (name, value) in enumerate(sorted(element.attributes.items())):
        if match := _CLARK_NAME.fullmatch(name):
            namespace, name = match.groups()
            if namespace == _XML:  # xml:base of an include that is expanded
                continue
            yield f' xmlns:n{number}="{escape(namespace, is_attribute=True)}"'
            name = f"n{number}:{name}"
        yield f' {name}="{escape(value, is_attribute=True)}"'


def _sorted(children: list[XmlElement]) -> list[XmlElement]:
    """Return children in the order of `ros2 security generate_policy`, comments first."""

    def key(child: XmlElement) -> tuple[str, ...]:
        if child.tag == COMMENT:
            return ("", "", "", "")
        get = child.attributes.get
        return child.tag, child.text.strip(), get("ns", "") + get("node", ""), get("path", "")

    result: list[XmlElement] = []
    for child in sorted(children, key=key):
        is_repeated = result and child.tag in _NAMES and key(child) == key(result[-1])
        if not is_repeated:
            result.append(child)
    return result
