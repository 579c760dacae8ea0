"""``metadata.yaml`` of rosbag2 folders, and QoS as bags carry it.

Written is version 8, which Humble to Kilted read; read are versions 1 to 9.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from rosidl_py_gen.bags.common import BagError, BagTopic, replace_durably
from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.base.yaml_text import MAX_BYTES, YamlError, load_yaml
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime.qos import INFINITE_NS, POLICIES

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

FILE = "metadata.yaml"
_MAX_QOS_BYTES = 1 << 20
"""Size limit of a topic's QoS text, in bytes: one publisher takes about 400."""
PERIODS = {"deadline_ns": "deadline", "lifespan_ns": "lifespan", "liveliness_lease_ns": "liveliness_lease_duration"}
"""Field of a profile -> how rosbag2 calls it."""


@dataclass(frozen=True, slots=True)
class BagMetadata:
    """What a metadata file says.

    Attributes:
        storage: ``mcap`` or ``sqlite3``.
        files: names below the folder, in their order.
        compression: of whole files or of messages (``zstd``), empty for none; not that inside MCAP files.
    """

    storage: str
    files: tuple[str, ...]
    topics: tuple[BagTopic, ...] = ()
    compression: str = ""
    compression_mode: str = ""


def read_metadata(folder: Path) -> BagMetadata:
    """Raises `BagError`: no such file, no YAML, or something is missing in it."""
    path = folder / FILE
    try:
        with path.open("rb") as stream:
            text = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise BagError(f"{path}: {error.strerror}; a bag folder has this file") from None
    try:
        told = load_yaml(text)
    except YamlError as error:
        raise BagError(f"{path}: not YAML: {error}") from None
    try:
        return _parsed(told["rosbag2_bagfile_information"])
    except Exception as error:  # KeyError, TypeError, OverflowError of infinity, RecursionError while dumping QoS
        reason = f"not as rosbag2 writes it: {type(error).__name__} {str(error)[:200]}"
        raise BagError(f"{path}: {reason}; `rosidl-py bag reindex` writes it again") from None


def _plain(told: Any) -> str | int | float:
    """Raises TypeError for all else: as text, a list of aliases of lists of aliases takes all memory."""
    if not isinstance(told, (str, int, float)):
        raise TypeError(f"{type(told).__name__}, expected a text or a number")
    return told


def _text(told: Any) -> str:
    return str(_plain(told))


def _file(told: Any) -> str:
    """The name, which never leads out of the folder."""
    if "\0" in (name := Path(_text(told)).name):
        raise ValueError("a file name with a zero byte")
    return name


def _parsed(told: Any) -> BagMetadata:
    files = tuple(map(_file, told["relative_file_paths"]))
    topics = []
    for one in told.get("topics_with_message_count") or ():
        topic, count = one["topic_metadata"], one["message_count"]
        qos = topic.get("offered_qos_profiles") or ""
        topics.append(
            BagTopic(
                _text(topic["name"]),
                _text(topic["type"]),
                message_encoding=_text(topic["serialization_format"]),
                type_hash=_text(topic.get("type_description_hash") or ""),
                offered_qos=qos if isinstance(qos, str) else yaml.safe_dump(qos),
                count=int(count),
            )
        )
    storage, mode = _text(told["storage_identifier"]), _text(told.get("compression_mode") or "").lower()
    return BagMetadata(storage, files, tuple(topics), _text(told.get("compression_format") or "").lower(), mode)


@dataclass(slots=True)
class FileStatistics:
    """What is counted while a file is written; times in nanoseconds."""

    path: str
    first: int | None = None
    last: int = 0
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, topic: str, log_time: int) -> None:
        """Count a message."""
        self.first = log_time if self.first is None else min(self.first, log_time)
        self.last = max(self.last, log_time)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    @property
    def total(self) -> int:
        """Messages."""
        return sum(self.counts.values())

    @property
    def duration(self) -> int:
        """From the first to the last message."""
        return 0 if self.first is None else self.last - self.first


def metadata_text(
    storage: str,
    files: Iterable[FileStatistics],
    topics: Iterable[BagTopic],
    *,
    compression_mode: str = "",
    custom_data: Mapping[str, str] | None = None,
) -> str:
    """The text of a metadata file; `compression_mode` is ``file`` or ``message`` where zstd is used for these."""
    files = list(files)
    starts = [one.first for one in files if one.first is not None]
    start, end = min(starts, default=0), max((one.last for one in files), default=0)
    information = {
        "version": 8,
        "storage_identifier": storage,
        "duration": {"nanoseconds": max(0, end - start) if starts else 0},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(one.total for one in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": topic.message_encoding,
                    "offered_qos_profiles": topic.offered_qos,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": sum(one.counts.get(topic.name, 0) for one in files),
            }
            for topic in topics
        ],
        "compression_format": "zstd" if compression_mode else "",
        "compression_mode": compression_mode.upper(),
        "relative_file_paths": [one.path for one in files],
        "files": [
            {
                "path": one.path,
                "starting_time": {"nanoseconds_since_epoch": one.first or 0},
                "duration": {"nanoseconds": one.duration},
                "message_count": one.total,
            }
            for one in files
        ],
        "custom_data": dict(custom_data) if custom_data else None,
        "ros_distro": "",
    }
    return yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)


def write_metadata(folder: Path, text: str) -> None:
    """Write ``metadata.yaml``, or nothing at all.

    Raises:
        OSError: the disk is full; what was there before is still there.
    """
    partial = folder / f".{FILE}"
    try:
        partial.write_text(text, encoding="utf-8")
        replace_durably(partial, folder / FILE)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def qos_text(profiles: Iterable[QoSProfile]) -> str:
    """QoS profiles as rosbag2 keeps them with a topic."""
    return yaml.safe_dump([_row(profile) for profile in profiles], sort_keys=False)


def _row(profile: QoSProfile) -> dict[str, Any]:
    return {
        "history": int(profile.history),
        "depth": profile.depth,
        "reliability": int(profile.reliability),
        "durability": int(profile.durability),
        "deadline": _time(profile.deadline_ns),
        "lifespan": _time(profile.lifespan_ns),
        "liveliness": int(profile.liveliness),
        "liveliness_lease_duration": _time(profile.liveliness_lease_ns),
        "avoid_ros_namespace_conventions": profile.avoid_ros_namespace_conventions,
    }


def _time(nanoseconds: int) -> dict[str, int]:
    return dict(zip(("sec", "nsec"), sec_nanosec(nanoseconds), strict=True))


def qos_profiles(text: str) -> list[QoSProfile]:
    """The profiles of a topic's text, with the numbers or the words of rosbag2; none when it cannot be read."""
    try:
        return [_profile(row) for row in load_yaml(text, max_bytes=_MAX_QOS_BYTES) or ()]
    except Exception:  # as of `read_metadata`
        return []


def _profile(row: Any) -> QoSProfile:
    values: dict[str, Any] = {}
    for name, kind in POLICIES.items():
        told: Any = _plain(row[name])
        values[name] = kind[told.upper()] if isinstance(told, str) else kind(told)
    for name, key in PERIODS.items():
        values[name] = min(int(row[key]["sec"]) * NS_PER_S + int(row[key]["nsec"]), INFINITE_NS)
    return QoSProfile(depth=int(row["depth"]), **values)
