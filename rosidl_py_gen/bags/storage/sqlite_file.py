"""A ``.db3`` file of rosbag2.

Decides how it is opened: as something that does not change, so that nothing appears beside it; unless a journal lies
there, as after a crash or while it is recorded, whose messages would be missing.
"""

from __future__ import annotations

import shutil
import sqlite3
from io import SEEK_END
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags.common import BagError, BagTopic
from rosidl_py_gen.bags.storage.mcap_file import joined
from rosidl_py_gen.bags.storage.storage_api import BagChannel, library_errors_as_bag_error

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from rosidl_py_gen.bags.storage.storage_api import Raw

_TABLES = "messages", "topics", "message_definitions"
"""What is read of a database."""
_JOURNALS = "-wal", "-journal"
_JOURNAL_MAGIC = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
"""What a journal begins with, and ends with when it names a journal of several databases."""
_MAX_TIME = (1 << 63) - 1


class SqliteFile:
    """A ``.db3`` file of rosbag2. Any thread may read it."""

    is_whole = True
    unread_bytes = 0

    def parts(self) -> list[tuple[int, int]]:
        return []

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.is_file():
            raise BagError(f"{path}: there is no such file")
        self._copy: TemporaryDirectory[str] | None = None
        self._without_topic: dict[Any, BagTopic] = {}
        with library_errors_as_bag_error(path):
            self._base = self._connected()
        try:
            with library_errors_as_bag_error(path):
                self._base.execute("pragma trusted_schema=off")
                self._require_tables()
        except BaseException:
            self.close()
            raise

    def _connected(self) -> sqlite3.Connection:
        real = self._path.resolve()  # beside which SQLite looks for them
        ends = [end for end in _JOURNALS if Path(f"{real}{end}").is_file()]
        if not any(Path(f"{real}{end}").stat().st_size for end in ends):
            return _connect(self._path, "mode=ro&immutable=1")
        base = _connect(self._path, "mode=ro")
        try:
            base.execute("select count(*) from sqlite_master").fetchone()
            return base
        except sqlite3.OperationalError:  # it has to be rolled back, or its folder cannot be written to
            base.close()
        self._copy = TemporaryDirectory(prefix="rosidl-py-gen-bag-")
        copied = Path(self._copy.name, "bag.db3")
        for end in ("", *ends):
            shutil.copyfile(f"{real}{end}", f"{copied}{end}")
        _require_own_journal(self._path, Path(f"{copied}-journal"))
        return _connect(copied, "mode=rw")

    def _require_tables(self) -> None:
        """Raises `BagError` when something is computed, not stored: a few bytes can make rows without end."""
        for name, kind, text in self._base.execute("select lower(name), type, lower(sql) from sqlite_master"):
            if name in _TABLES and (kind != "table" or "virtual" in str(text)):
                raise BagError(f"{self._path}: {name} is no stored table")
        for name in _TABLES:
            if any(row[6] for row in self._base.execute(f"pragma table_xinfo({name})")):
                raise BagError(f"{self._path}: {name} has columns that are not stored")

    # ------------------------------------------------------------------------------------------------------ contents

    def channels(self) -> list[BagTopic]:
        with library_errors_as_bag_error(self._path):
            counts = dict(self._base.execute("select topic_id, count(*) from messages group by topic_id"))
            topics = self._topics(counts)
            self._without_topic = {
                key: _placeholder_topic(key, count) for key, count in counts.items() if key not in topics
            }
            return joined([*topics.values(), *self._without_topic.values()])

    def _topics(self, counts: dict[Any, int]) -> dict[Any, BagTopic]:
        """Rows of topics, by the number that messages name them with."""
        texts = self._definitions()
        columns = self._columns("topics")
        optional = [name if name in columns else "''" for name in ("offered_qos_profiles", "type_description_hash")]
        rows = self._base.execute(f"select id, name, type, serialization_format, {', '.join(optional)} from topics")
        found = {}
        for row in rows.fetchall():
            key, (name, kind, how, qos, told) = row[0], map(str, row[1:])
            text, encoding = _pick_definition(texts.get(kind, []), told)
            found[key] = BagTopic(name, kind, text, encoding, how, told, qos, counts.get(key, 0))
        return found

    def _columns(self, table: str) -> set[str]:
        return {row[1] for row in self._base.execute(f"pragma table_info({table})")}

    def _definitions(self) -> dict[str, list[tuple[str, str, str]]]:
        """Hash, text and encoding by name; a type may have been recorded in two versions."""
        columns = self._columns("message_definitions")
        if not columns:
            return {}
        hashes = "type_description_hash" if "type_description_hash" in columns else "''"
        rows = self._base.execute(
            f"select topic_type, {hashes}, encoded_message_definition, encoding from message_definitions"
        )
        found: dict[str, list[tuple[str, str, str]]] = {}
        for name, told, text, encoding in rows:
            found.setdefault(str(name), []).append((str(told), str(text), str(encoding)))
        return found

    def span(self) -> tuple[int, int] | None:
        with library_errors_as_bag_error(self._path):
            first, last = self._base.execute("select min(timestamp), max(timestamp) from messages").fetchone()
            if first is None:
                return None
            if not isinstance(first, int) or not isinstance(last, int):
                raise BagError(f"{self._path}: a message has no time")
            return first, last

    # ------------------------------------------------------------------------------------------------------ messages

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[Raw]:
        with library_errors_as_bag_error(self._path):
            known = {key: BagChannel(topic) for key, topic in {**self._without_topic, **self._topics({})}.items()}
            wanted = [key for key, channel in known.items() if topics is None or channel.topic in topics]
            marks = "" if topics is None else f"topic_id in ({','.join('?' * len(wanted))}) and "
            rows = self._base.execute(
                f"select topic_id, timestamp, data from messages where {marks}timestamp >= ? and timestamp <= ? "
                "order by timestamp, id",
                [*(wanted if marks else ()), min(start, _MAX_TIME), min(end - 1, _MAX_TIME)],
            )
            for key, stamp, data in rows:
                if key not in known:
                    known[key] = BagChannel(_placeholder_topic(key))
                if not isinstance(data, bytes) or not isinstance(stamp, int):
                    raise BagError(f"{self._path}: a message on {known[key].topic} is no bytes with a time")
                yield known[key], data, stamp, stamp

    def blocks(self, topics: Collection[str] | None, start: int, end: int) -> None:
        return None

    def close(self) -> None:
        self._base.close()
        if self._copy is not None:
            self._copy.cleanup()


def _pick_definition(texts: list[tuple[str, str, str]], wanted: str) -> tuple[str, str]:
    """Text and encoding of the definition with a hash; of that without one only where there is no other."""
    fitting = [one for one in texts if one[0] == wanted] or [one for one in texts if not (one[0] and wanted)]
    return fitting[0][1:] if len({one[1:] for one in fitting}) == 1 else ("", "")


def _placeholder_topic(key: object, count: int | None = None) -> BagTopic:
    """Stands for a topic whose row is missing, so that what was recorded of it is counted and can be had as bytes."""
    return BagTopic(f"(no topic has id {key!r})", "", count=count)


def _require_own_journal(path: Path, journal: Path) -> None:
    """Raises `BagError`: SQLite deletes the file that a journal of several databases names, whatever it is."""
    if journal.is_file():
        with journal.open("rb") as stream:
            stream.seek(-min(len(_JOURNAL_MAGIC), journal.stat().st_size), SEEK_END)
            if stream.read() == _JOURNAL_MAGIC:
                raise BagError(f"{path}: its -journal is of several databases; expected one of this file alone")


def _connect(path: Path, how: str) -> sqlite3.Connection:
    # Read by one thread at a time, each by cursors of its own; the library itself is built for that.
    return sqlite3.connect(f"{path.resolve().as_uri()}?{how}", uri=True, check_same_thread=False)
