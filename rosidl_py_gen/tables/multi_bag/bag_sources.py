"""Many bags: which ones are meant, how each is called in a dataset, and how one knows that it has changed."""

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
from rosidl_py_gen.tables.dataset import bag_name
from rosidl_py_gen.tables.output_files import file_system, url_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

_TAGS = "ETag", "etag", "md5Hash", "content_md5", "generation", "checksum"
_TIMES = "mtime", "LastModified", "last_modified", "updated", "modified", "created"
_WILD = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class BagSource:
    """A bag.

    Attributes:
        place: an absolute path, or a URL.
        size: bytes of its files.
        version: what changes with its files: their sizes, and their tags or the times they were changed.
    """

    place: str
    size: int
    version: str


def find(bags: Iterable[str]) -> tuple[list[BagSource], dict[str, str]]:
    """The bags that paths and URLs mean, in which ``*`` is fsspec's; and those that are not there, with the reason."""
    found: dict[str, BagSource] = {}
    failed: dict[str, str] = {}
    for bag in bags:
        try:
            with unreachable_as_error(bag):
                some = _found(bag)
        except (RosidlError, OSError) as error:
            failed[bag] = f"{bag}: there is no such bag" if isinstance(error, FileNotFoundError) else str(error)
            continue
        found.update((one.place, one) for one in some)
    return list(found.values()), failed


def _found(bag: str) -> list[BagSource]:
    place = bag if is_url(bag) else os.path.abspath(bag)
    system, path = file_system(place)
    system.invalidate_cache()
    if _WILD.isdisjoint(path) or system.exists(path):
        return [_described(system, place, system.info(path))]
    some = system.glob(path, detail=True)
    if not some:
        raise BagError(f"{bag}: nothing is called so")
    return [_described(system, url_of(place, path), info) for path, info in sorted(some.items())]


def _described(system: Any, place: str, info: Mapping[str, Any]) -> BagSource:
    if info["type"] == "directory":
        files = sorted(system.find(info["name"], detail=True).values(), key=lambda one: str(one["name"]))
        if not files:
            raise BagError(f"{place}: a folder without files")
    else:
        files = [dict(info)]
    told = [(PurePath(one["name"]).name, int(one["size"] or 0), _mark(one)) for one in files]
    return BagSource(place, sum(size for _, size, _ in told), digest(told))


def _mark(info: Mapping[str, Any]) -> str:
    return str(next((info[key] for key in (*_TAGS, *_TIMES) if info.get(key)), ""))


def digest(told: Any) -> str:
    """A short name for values of JSON."""
    return sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]


def names_of(places: Iterable[str], known: Mapping[str, str] | None = None) -> dict[str, str]:
    """A name for each bag that no other has: that of its file, with folders before it where that is not enough.

    Args:
        known: names of bags by their places, which they keep, and no other gets.
    """
    known = known or {}
    wanted = list(dict.fromkeys(places))
    parts = {place: _parts(place) for place in {**dict.fromkeys(wanted), **dict.fromkeys(known)}}
    names: dict[str, str] = {}
    taken = set(known.values())
    for place in wanted:
        own, length = parts[place], 1
        if place in known:
            names[known[place]] = place
            continue
        while length < len(own) and (
            sum(own[-length:] == other[-length:] for other in parts.values()) > 1 or "/".join(own[-length:]) in taken
        ):
            length += 1
        name = "/".join(own[-length:])
        names[name if name not in names and name not in taken else place] = place
    return names


def _parts(place: str) -> list[str]:
    path = place.partition("://")[2] if is_url(place) else os.path.abspath(place)
    return [bag_name(part) for part in PurePath(path).parts if part.strip("/\\")] or ["bag"]
