"""Sources of a dataset: the bags that patterns match, their names in the dataset, and their versions."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from hashlib import sha256
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.remote import is_url, unreachable_as_error
from rosidl_py_gen.errors import RosidlError
from rosidl_py_gen.tables.dataset_writer import bag_name
from rosidl_py_gen.tables.output_files import file_system, url_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_TAG_KEYS = ("ETag", "etag", "md5Hash", "content_md5", "generation", "checksum")
_TIME_KEYS = ("mtime", "LastModified", "last_modified", "updated", "modified", "created")
_WILDCARDS = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class BagSource:
    """Source bag of a dataset.

    Attributes:
        place: an absolute path, or a URL.
        version: digest of the sizes of its files and their tags or modification times.
    """

    place: str
    size: int
    version: str


def find_bags(bags: Iterable[str]) -> tuple[list[BagSource], dict[str, str]]:
    """Return the bags that paths and URLs, with ``*`` as in fsspec, match; and the errors of the others."""
    sources: dict[str, BagSource] = {}
    failed: dict[str, str] = {}
    for bag in bags:
        try:
            with unreachable_as_error(bag):
                matches = _matches(bag)
        except (RosidlError, OSError) as error:
            failed[bag] = f"{bag}: there is no such bag" if isinstance(error, FileNotFoundError) else str(error)
            continue
        sources.update((one.place, one) for one in matches)
    return list(sources.values()), failed


def _matches(bag: str) -> list[BagSource]:
    place = bag if is_url(bag) else os.path.abspath(bag)
    system, path = file_system(place)
    system.invalidate_cache()
    if _WILDCARDS.isdisjoint(path) or system.exists(path):
        return [_source(system, place, system.info(path))]
    matches = system.glob(path, detail=True)
    if not matches:
        raise BagError(f"{bag}: no bag matches")
    return [_source(system, url_of(place, path), info) for path, info in sorted(matches.items())]


def _source(system: Any, place: str, info: Mapping[str, Any]) -> BagSource:
    if info["type"] == "directory":
        files = sorted(system.find(info["name"], detail=True).values(), key=lambda one: str(one["name"]))
        if not files:
            raise BagError(f"{place}: the folder has no files")
    else:
        files = [dict(info)]
    versions = [(PurePath(one["name"]).name, int(one["size"] or 0), _tag_or_time(one)) for one in files]
    return BagSource(place, sum(size for _, size, _ in versions), digest(versions))


def _tag_or_time(info: Mapping[str, Any]) -> str:
    return str(next((info[key] for key in (*_TAG_KEYS, *_TIME_KEYS) if info.get(key)), ""))


def digest(values: Any) -> str:
    """Return a short digest of values of JSON."""
    return sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


def names_of(places: Iterable[str], known: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return a unique name for each bag: that of its file, with folders before it if necessary.

    `known` has existing names by place, which are kept and not assigned to others.
    """
    known = known or {}
    places = list(dict.fromkeys(places))
    paths = {place: _path_names(place) for place in (*places, *known)}
    names: dict[str, str] = {}
    reserved = set(known.values())
    for place in places:
        own, length = paths[place], 1
        if place in known:
            names[known[place]] = place
            continue
        while length < len(own) and (
            sum(own[-length:] == other[-length:] for other in paths.values()) > 1 or "/".join(own[-length:]) in reserved
        ):
            length += 1
        name = "/".join(own[-length:])
        names[name if name not in names and name not in reserved else place] = place
    return names


def _path_names(place: str) -> list[str]:
    path = place.partition("://")[2] if is_url(place) else os.path.abspath(place)
    return [bag_name(part) for part in PurePath(path).parts if part.strip("/\\")] or ["bag"]
