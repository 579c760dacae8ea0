"""Reader of one or several bags that are played together."""

from __future__ import annotations

from heapq import heappop, heappush, merge
from operator import attrgetter
from typing import TYPE_CHECKING

from rosidl_py_gen.bags import BagReader
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.bag.display import ProgressBar
from rosidl_py_gen.ros_cli.name_lookup import topic_owner

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from rosidl_py_gen.bags import BagTopic, RawMessage

_KINDS = {".db3": "sqlite3", ".mcap": "mcap"}


class Recording:
    """Bags whose messages are played by their times; use it with ``with``.

    Args:
        storage: required storage of all files, if the user stated one.

    Raises:
        CommandError: a bag has another storage.
        BagError, OSError: as for `BagReader`.
    """

    def __init__(self, places: Sequence[str], paths: Sequence[str], storage: str | None = None) -> None:
        self._readers: list[BagReader] = []
        try:
            for place in places:
                with ProgressBar("bytes") as show:
                    reader = BagReader(place, search_path=paths, skip_damaged=True, on_progress=show)
                self._readers.append(reader)
                _require_storage(self._readers[-1], storage)
        except BaseException:
            self.close()
            raise
        self.name = ", ".join(str(reader.path) for reader in self._readers)
        """Paths of the bags, for messages."""
        self.channels: list[tuple[BagReader, BagTopic]] = [
            (reader, channel) for reader in self._readers for channel in reader.channels
        ]
        """Recorded channels and the reader of each."""
        self.owners = {channel.name: topic_owner(channel.name, channel.type_name) for _, channel in self.channels}
        """Service, action or topic that each topic belongs to."""
        self.topics = sorted(self.owners)
        filled = [reader for reader in self._readers if reader.end_ns]
        self.start_ns = min((reader.start_ns for reader in filled), default=0)
        """Log time of the first message; 0 without messages."""
        self.end_ns = max((reader.end_ns for reader in filled), default=0)
        """Log time of the last message."""

    def messages(self, topics: Sequence[str], start_ns: int, end_ns: int) -> Iterator[RawMessage]:
        """Yield messages with ``start_ns <= log_time < end_ns``, by log time."""
        each = [
            reader.raw_messages([name for name in topics if name in reader.topics], start_ns=start_ns, end_ns=end_ns)
            for reader in self._readers
        ]
        return each[0] if len(each) == 1 else merge(*each, key=attrgetter("log_time"))

    @property
    def is_damaged(self) -> bool:
        """True if damaged parts were skipped so far."""
        return any(reader.damaged for reader in self._readers)

    def close(self) -> None:
        """Close the bags; may be called repeatedly."""
        for reader in self._readers:
            reader.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _require_storage(reader: BagReader, storage: str | None) -> None:
    for file in reader.files:
        actual = _KINDS.get(file.suffix if file.suffix in _KINDS else file.with_suffix("").suffix, "")
        if storage is not None and actual != storage:
            raise CommandError(f"{file}: storage is {actual}; expected {storage}, or no --storage")


def by_publish_time(messages: Iterable[RawMessage], ahead: int) -> Iterator[RawMessage]:
    """Sort messages by publish time within a window of `ahead` messages."""
    waiting: list[tuple[int, int, RawMessage]] = []
    for number, message in enumerate(messages):
        heappush(waiting, (message.publish_time, number, message))
        if len(waiting) > ahead:
            yield heappop(waiting)[2]
    while waiting:
        yield heappop(waiting)[2]
