"""Reader of name, version and build type in a package.xml, which may be malformed.

Values of a malformed file are returned as far as they can be read, so that one file does not end the search of a
workspace. The time is linear in the size of the file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

_START = re.compile(r"<(name|version|build_type)(?=[\s>])")


class ManifestValues(NamedTuple):
    """Name, version and build type of a package.xml; missing values are empty.

    Attributes:
        build_type: the build type for ROS 2; types with the condition `$ROS_VERSION == 1` are skipped.
    """

    name: str = ""
    version: str = ""
    build_type: str = ""


def read_package_manifest(text: str) -> ManifestValues:
    """Return name, version and build type from the text of a package.xml."""
    found: dict[str, str] = {}
    for tag, attributes, content in _elements(text):
        is_of_ros_1 = tag == "build_type" and "ROS_VERSION==1" in "".join(attributes.split())
        if content and not is_of_ros_1:
            found.setdefault(tag, content)
    return ManifestValues(**found)


def _elements(text: str) -> Iterator[tuple[str, str, str]]:
    """Yield tag, attributes and text of each XML element of a package.xml whose tag the reader uses."""
    text = _without_comments(text)
    position = 0
    while start := _START.search(text, position):
        close = text.find(">", start.end())
        position = text.find("<", close)
        if close < 0 or position < 0:
            return
        if text.startswith(f"</{start[1]}", position):
            yield start[1], text[start.end() : close], text[close + 1 : position].strip()


def _without_comments(text: str) -> str:
    parts = []
    position = 0
    while (start := text.find("<!--", position)) >= 0:
        parts.append(text[position:start])
        position = text.find("-->", start) + 3
        if position < 3:  # the comment has no end
            return "".join(parts)
    return "".join((*parts, text[position:]))
