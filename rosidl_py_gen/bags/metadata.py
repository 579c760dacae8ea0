"""Reader and writer of ``metadata.yaml`` in rosbag2 folders, and of the QoS profiles in it.

Written is version 8, which ROS 2 Humble to Kilted read. Versions 1 to 9 are read.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import yaml

from rosidl_py_gen.bags.common import BagError, BagTopic, DurableFile
from rosidl_py_gen.base.stamps import NS_PER_S, sec_nanosec
from rosidl_py_gen.base.terminal_text import pluralize
from rosidl_py_gen.base.yaml_text import YamlError, YamlText
from rosidl_py_gen.errors import printable
from rosidl_py_gen.runtime import QoSProfile
from rosidl_py_gen.runtime import qos as presets

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

FILE = "metadata.yaml"
_ROOT = "rosbag2_bagfile_information"
_MAX_BYTES = 1 << 26
"""Maximum bytes of ``metadata.yaml``; rosbag2 writes about 250 bytes for each file and topic of a bag."""
_MAX_COUNT = 1 << 64
"""Maximum number of messages of a topic that a note about lost messages states; the file may state any number."""
_MAX_QOS_BYTES = 1 << 20
"""Maximum bytes of a topic's QoS text; one publisher takes about 400 bytes."""
_POLICIES = sorted(presets.POLICIES, key=lambda policy: [one.name for one in fields(QoSProfile)].index(policy.field))
"""All QoS policies in the order in which rosbag2 writes them, which is the order of the fields of `QoSProfile`."""


@dataclass(frozen=True, slots=True)
class BagMetadata:
    """Contents of a ``metadata.yaml``.

    Attributes:
        storage: ``mcap`` or ``sqlite3``.
        files: names in the folder, in the order of recording.
        compression: of whole files or of messages (``zstd``), empty for none; not of chunks inside MCAP files.
        compression_mode: ``file``, ``message``, ``none`` or empty.
        ros_distro: distribution of the recorder; empty if it is not known.
        custom_data: texts of the user.
    """

    storage: str
    files: tuple[str, ...]
    topics: tuple[BagTopic, ...] = ()
    compression: str = ""
    compression_mode: str = ""
    ros_distro: str = ""
    custom_data: Mapping[str, str] = field(default_factory=dict)

    def by_name(self) -> dict[tuple[str, str], BagTopic]:
        """Return the topics of the bag by name and type."""
        return {(topic.name, topic.type_name): topic for topic in self.topics}

    def loss_note(self, found: Mapping[str, int | None]) -> str:
        """Return a note if the files of the bag have fewer messages than ``metadata.yaml`` lists; else "".

        Args:
            found: number of messages by topic; None if it is not known. A topic that is missing has none.
        """
        listed: Counter[str] = Counter()
        for topic in self.topics:
            listed[topic.name] += min(topic.count or 0, _MAX_COUNT)
        differences = {name: listed[name] - number for name in listed if (number := found.get(name, 0)) is not None}
        lost = {name: number for name, number in differences.items() if number > 0}
        if not lost:
            return ""
        topics = printable(next(iter(lost))) if len(lost) == 1 else pluralize(len(lost), "topic")
        messages = pluralize(sum(lost.values()), "message")
        return f"{messages} of {topics} that {FILE} lists are lost: a file of the bag was cut off, replaced or removed"


def read_metadata(folder: Path) -> BagMetadata:
    """Return the contents of ``metadata.yaml`` in a folder.

    Raises:
        BagError: the file is missing, not YAML, or a value is missing in it.
    """
    path = folder / FILE
    try:
        with path.open("rb") as stream:
            text = stream.read(_MAX_BYTES + 1)
    except OSError as error:
        raise BagError(f"{path}: {error.strerror}; every bag folder has this file") from None
    try:
        value = YamlText(text, max_bytes=_MAX_BYTES).load()
    except YamlError as error:
        raise BagError(f"{path}: not YAML: {error}") from None
    try:
        value = value[_ROOT]
        return _parse_metadata(value, _custom_data(text, value))
    except Exception as error:  # KeyError, TypeError, OverflowError of infinity, RecursionError while dumping QoS
        reason = f"not in the format of rosbag2: {type(error).__name__} {str(error)[:200]}"
        raise BagError(f"{path}: {reason}; recreate it with `rosidl-py bag reindex`") from None


def _scalar(value: Any) -> str | int | float:
    """Return a YAML value if it is a text or a number, else raise TypeError.

    Text made from nested lists could be of any size, because YAML aliases repeat their content.
    """
    if not isinstance(value, (str, int, float)):
        raise TypeError(f"{type(value).__name__}, expected a text or a number")
    return value


def _text(value: Any) -> str:
    return str(_scalar(value))


def _file_name(value: Any) -> str:
    """Return the last component of a file name in ``metadata.yaml``, so that the name cannot refer to a file outside of
    the bag.
    """
    if "\0" in (name := Path(_text(value)).name):
        raise ValueError("a file name with a zero byte")
    return name


def _parse_metadata(value: Any, custom: dict[str, str]) -> BagMetadata:
    files = tuple(map(_file_name, value["relative_file_paths"]))
    topics = []
    for entry in value.get("topics_with_message_count") or ():
        topic, count = entry["topic_metadata"], entry["message_count"]
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
    storage, mode = _text(value["storage_identifier"]), _text(value.get("compression_mode") or "").lower()
    compression = _text(value.get("compression_format") or "").lower()
    distro = _text(value.get("ros_distro") or "")
    return BagMetadata(storage, files, tuple(topics), compression, mode, distro, custom)


def _custom_data(text: str | bytes, value: Any) -> dict[str, str]:
    """Return the user's custom data as written in the file: rosbag2 writes ``1.50`` and ``yes`` without quotes.

    A list or mapping, which rosbag2 does not read, becomes its YAML text.
    """
    values = value.get("custom_data")
    if not isinstance(values, dict) or not values:
        return {}
    texts = {key: one if isinstance(one, str) else yaml.safe_dump(one).strip() for key, one in values.items()}
    try:
        node: Any = YamlText(text).compose(anchors=True)
    except YamlError:  # it has aliases
        return texts
    for key in (_ROOT, "custom_data"):
        node = next((one for name, one in node.value if name.value == key), node)
    for key, scalar in node.value:
        if isinstance(scalar.value, str):
            is_null = scalar.style is None and scalar.value in ("~", "null")
            texts[key.value] = "" if is_null else scalar.value
    return texts


class RecorderData(NamedTuple):
    """Data of the recorder in rosbag2 metadata that is stored inside a bag file."""

    ros_distro: str = ""
    custom_data: Mapping[str, str] = {}


def recorder_data(text: str) -> RecorderData:
    """Return the recorder's data in rosbag2 metadata that is stored inside a bag file; empty values if it is missing.

    Raises `BagError` if the text has another format.
    """
    try:
        value = YamlText(text).load()
        if isinstance(value, dict) and isinstance(value.get(_ROOT), dict):
            value = value[_ROOT]
        if not isinstance(value, dict):
            return RecorderData()
        return RecorderData(_text(value.get("ros_distro") or ""), _custom_data(text, value))
    except Exception as error:  # the same as in `read_metadata`
        raise BagError(f"not in the format of rosbag2: {type(error).__name__} {str(error)[:200]}") from None


@dataclass(slots=True)
class FileStatistics:
    """Message counts and log times of a bag file that is being written; times are nanoseconds since 1970."""

    path: str
    first: int | None = None
    last: int = 0
    counts: dict[str, int] = field(default_factory=dict)

    def add(self, topic: str, log_time: int) -> None:
        self.first = log_time if self.first is None else min(self.first, log_time)
        self.last = max(self.last, log_time)
        self.counts[topic] = self.counts.get(topic, 0) + 1

    @property
    def total(self) -> int:
        """Number of messages of the file."""
        return sum(self.counts.values())


def metadata_text(
    storage: str,
    files: Iterable[FileStatistics],
    topics: Iterable[BagTopic],
    *,
    compression_mode: str = "",
    custom_data: Mapping[str, str] | None = None,
    ros_distro: str = "",
) -> str:
    """Return the text of a ``metadata.yaml``; `compression_mode` is ``file``, ``message`` or empty."""
    files = list(files)
    starts = [file.first for file in files if file.first is not None]
    start, end = min(starts, default=0), max((file.last for file in files), default=0)
    information = {
        "version": 8,
        "storage_identifier": storage,
        "duration": {"nanoseconds": max(0, end - start) if starts else 0},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.total for file in files),
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": topic.message_encoding,
                    "offered_qos_profiles": topic.offered_qos,
                    "type_description_hash": topic.type_hash,
                },
                "message_count": sum(file.counts.get(topic.name, 0) for file in files),
            }
            for topic in topics
        ],
        "compression_format": "zstd" if compression_mode else "",
        "compression_mode": compression_mode.upper(),
        "relative_file_paths": [file.path for file in files],
        "files": [
            {
                "path": file.path,
                "starting_time": {"nanoseconds_since_epoch": file.first or 0},
                "duration": {"nanoseconds": 0 if file.first is None else file.last - file.first},
                "message_count": file.total,
            }
            for file in files
        ],
        "custom_data": dict(custom_data) if custom_data else None,
        "ros_distro": ros_distro,
    }
    return yaml.safe_dump({_ROOT: information}, sort_keys=False)


def write_metadata(folder: Path, text: str) -> None:
    """Write ``metadata.yaml`` into a bag folder; if writing fails, as on a full disk, an existing file
    stays unchanged.
    """
    with DurableFile(folder / FILE) as partial:
        partial.write_text(text, encoding="utf-8")


class OfferedQoS(list[QoSProfile]):
    """QoS profiles that the publishers of a topic offer, which bags store as YAML."""

    @property
    def text(self) -> str:
        """The profiles in the YAML format of rosbag2."""
        return yaml.safe_dump([_profile_row(profile) for profile in self], sort_keys=False)

    @classmethod
    def parse(cls, text: str) -> OfferedQoS:
        """Return the profiles that a bag stores for a topic; none if the text cannot be read.

        Policies may be stored as numbers or as names. A policy that is not stored has its default.
        """
        try:
            return cls(_parse_profile(row) for row in YamlText(text, max_bytes=_MAX_QOS_BYTES).load() or ())
        except Exception:  # the same as in `read_metadata`
            return cls()


def _profile_row(profile: QoSProfile) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for policy in _POLICIES:
        value = getattr(profile, policy.field)
        row[policy.rmw_name] = _time(value) if policy.is_period else int(value) if policy.enum else value
    return row


def _time(nanoseconds: int) -> dict[str, int]:
    return dict(zip(("sec", "nsec"), sec_nanosec(nanoseconds), strict=True))


def _parse_profile(row: Any) -> QoSProfile:
    values: dict[str, Any] = {}
    known = [policy for policy in presets.POLICIES if policy.rmw_name in row]  # an older recorder may lack a policy
    if not known:
        raise ValueError("no policies")
    for policy in known:
        name = policy.rmw_name
        if policy.enum is not None:
            value: Any = _scalar(row[name])
            values[policy.field] = policy.enum[value.upper()] if isinstance(value, str) else policy.enum(value)
        elif policy.is_period:
            values[policy.field] = min(int(row[name]["sec"]) * NS_PER_S + int(row[name]["nsec"]), presets.INFINITE_NS)
        elif policy.limits is not None:
            values[policy.field] = int(row[name])
        elif name != "avoid_ros_namespace_conventions":  # a matter of the topic's name, which the bag has
            values[policy.field] = row[name]
    return QoSProfile(**values)
