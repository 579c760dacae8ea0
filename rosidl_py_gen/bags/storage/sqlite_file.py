"""Reader of a ``.db3`` file of rosbag2.

The file is opened as immutable, so that SQLite creates no files next to it. A file with a journal, as after a crash or
during recording, is opened normally: its last messages are in the journal.
"""

from __future__ import annotations

import shutil
import sqlite3
from io import SEEK_END
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

from rosidl_py_gen.bags.common import BagError, BagTopic
from rosidl_py_gen.bags.storage.storage_api import BagChannel, Storage, library_errors_as_bag_error

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from rosidl_py_gen.bags.storage.storage_api import RawTuple

_TABLES = "messages", "topics", "message_definitions", "schema", "metadata"
"""Names of the SQLite tables of rosbag2 that the reader reads."""
_MAX_METADATA_BYTES = 1 << 20
"""Maximum size of a stored ``metadata.yaml`` that is read, as for MCAP files."""
JOURNALS = "-wal", "-journal"
"""Name endings of SQLite's journals, files next to a database that contain its last changes."""
_JOURNAL_MAGIC = b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
"""First bytes of a rollback journal, and last bytes of a journal that belongs to several databases."""
_MAX_TIME = (1 << 63) - 1
_Definition: TypeAlias = "tuple[str, str, str, bytes | None]"
"""Definition in a SQLite bag: hash, text, encoding, and the bytes of the definition if they are not valid text."""


class SqliteFile(Storage):
    """Reader of a ``.db3`` file of rosbag2. Thread: any."""

    def __init__(self, path: Path) -> None:
        self._path = path
        if not path.is_file():
            raise BagError(f"{path}: file does not exist")
        self._copy: TemporaryDirectory[str] | None = None
        self._without_topic: dict[Any, BagTopic] = {}
        with library_errors_as_bag_error(path):
            self._database = self._open_database()
        try:
            with library_errors_as_bag_error(path):
                self._database.execute("pragma trusted_schema=off")
                self._require_tables()
        except BaseException:
            self.close()
            raise

    def _open_database(self) -> sqlite3.Connection:
        real = self._path.resolve()  # SQLite expects journals next to it
        ends = [end for end in JOURNALS if Path(f"{real}{end}").is_file()]
        self._has_journal = any(Path(f"{real}{end}").stat().st_size for end in ends)
        if not self._has_journal:
            return _connect(self._path, "mode=ro&immutable=1")
        base = _connect(self._path, "mode=ro")
        try:
            base.execute("select count(*) from sqlite_master").fetchone()
            return base
        except sqlite3.OperationalError:  # it must be rolled back, or its folder is read-only
            base.close()
        self._copy = TemporaryDirectory(prefix="rosidl-py-gen-bag-")
        copied = Path(self._copy.name, "bag.db3")
        for end in ("", *ends):
            shutil.copyfile(f"{real}{end}", f"{copied}{end}")
        _require_own_journal(self._path, Path(f"{copied}-journal"))
        return _connect(copied, "mode=rw")

    def _require_tables(self) -> None:
        """Raise `BagError` if a table of rosbag2 is an SQL view, virtual or generated, because such a table could have
        endless rows.
        """
        for name, type_name, text in self._database.execute("select lower(name), type, lower(sql) from sqlite_master"):
            if name in _TABLES and (type_name != "table" or "virtual" in str(text)):
                raise BagError(f"{self._path}: {name} is a view or virtual table; expected a plain table")
        for name in _TABLES:
            if any(row[6] for row in self._database.execute(f"pragma table_xinfo({name})")):
                raise BagError(f"{self._path}: {name} has generated columns; expected a plain table")

    @property
    def has_journal(self) -> bool:
        return self._has_journal

    def stored_channels(self) -> list[BagTopic]:
        with library_errors_as_bag_error(self._path):
            counts = dict(self._database.execute("select topic_id, count(*) from messages group by topic_id"))
            topics = self._topics(counts)
            self._without_topic = {
                key: _placeholder_topic(key, count) for key, count in counts.items() if key not in topics
            }
            return [*topics.values(), *self._without_topic.values()]

    def _topics(self, counts: dict[Any, int]) -> dict[Any, BagTopic]:
        texts = self._definitions()
        columns = self._columns("topics")
        optional = [name if name in columns else "''" for name in ("offered_qos_profiles", "type_description_hash")]
        rows = self._database.execute(f"select id, name, type, serialization_format, {', '.join(optional)} from topics")
        topics = {}
        for row in rows.fetchall():
            key, (name, type_name, options, qos, type_hash) = row[0], map(str, row[1:])
            text, encoding, data = _pick_definition(texts.get(type_name, []), type_hash)
            topics[key] = BagTopic(
                name, type_name, text, encoding, options, type_hash, qos, counts.get(key, 0), schema_data=data
            )
        return topics

    def _columns(self, table: str) -> set[str]:
        return {row[1] for row in self._database.execute(f"pragma table_info({table})")}

    def _definitions(self) -> dict[str, list[_Definition]]:
        columns = self._columns("message_definitions")
        if not columns:
            return {}
        hashes = "type_description_hash" if "type_description_hash" in columns else "''"
        rows = self._database.execute(
            f"select topic_type, {hashes}, encoded_message_definition, encoding from message_definitions"
        )
        definitions: dict[str, list[_Definition]] = {}
        for name, type_hash, text, encoding in rows:
            data = text if isinstance(text, bytes) else None
            text = str(text) if data is None else data.decode(errors="replace")
            definitions.setdefault(str(name), []).append((str(type_hash), text, str(encoding), data))
        return definitions

    def unused_schemas(self) -> list[BagTopic]:
        with library_errors_as_bag_error(self._path):
            used = {(one.type_name, one.definition, one.encoding) for one in self._topics({}).values()}
            return [
                BagTopic("", name, text, encoding, "cdr", type_hash, schema_data=data)
                for name, texts in self._definitions().items()
                for type_hash, text, encoding, data in texts
                if (name, text, encoding) not in used
            ]

    def metadata_texts(self) -> list[str]:
        with library_errors_as_bag_error(self._path):
            if "metadata" not in self._columns("metadata"):
                return []
            rows = self._database.execute(
                "select metadata from metadata where length(metadata) <= ? order by id", (_MAX_METADATA_BYTES,)
            )
            return [str(row[0]) for row in rows]

    def unknown_tables(self) -> int:
        with library_errors_as_bag_error(self._path):
            rows = self._database.execute(
                "select count(*) from sqlite_master where type = 'table' and name not like 'sqlite\\_%' escape '\\' "
                f"and lower(name) not in ({','.join('?' * len(_TABLES))})",
                _TABLES,
            )
            count: int = rows.fetchone()[0]
        return count

    def copy_to(self, target: Path) -> None:
        """Write a complete copy of the database without journal to `target`; raises `BagError` if that fails."""
        try:
            copied = sqlite3.connect(target)
            try:
                self._database.backup(copied)
                copied.execute("pragma journal_mode=delete")
            finally:
                copied.close()
        except sqlite3.Error as error:
            raise BagError(f"{target}: cannot be written: {error}") from None

    def ros_distro(self) -> str:
        with library_errors_as_bag_error(self._path):
            if "ros_distro" not in self._columns("schema"):
                return ""
            row = self._database.execute("select ros_distro from schema").fetchone()
        return str(row[0]) if row else ""

    def span(self) -> tuple[int, int] | None:
        with library_errors_as_bag_error(self._path):
            first, last = self._database.execute("select min(timestamp), max(timestamp) from messages").fetchone()
            if first is None:
                return None
            if not isinstance(first, int) or not isinstance(last, int):
                raise BagError(f"{self._path}: a message has no time")
            return first, last

    def messages(self, topics: Collection[str] | None, start: int, end: int) -> Iterator[RawTuple]:
        with library_errors_as_bag_error(self._path):
            known = {key: BagChannel(topic) for key, topic in {**self._without_topic, **self._topics({})}.items()}
            requested = [key for key, channel in known.items() if topics is None or channel.topic in topics]
            marks = "" if topics is None else f"topic_id in ({','.join('?' * len(requested))}) and "
            rows = self._database.execute(
                f"select topic_id, timestamp, data from messages where {marks}timestamp >= ? and timestamp <= ? "
                "order by timestamp, id",
                [*(requested if marks else ()), min(start, _MAX_TIME), min(end - 1, _MAX_TIME)],
            )
            for key, stamp, data in rows:
                if key not in known:
                    known[key] = BagChannel(_placeholder_topic(key))
                if not isinstance(data, bytes) or not isinstance(stamp, int):
                    raise BagError(
                        f"{self._path}: a message on {known[key].topic} does not consist of bytes and a time"
                    )
                yield known[key], data, stamp, stamp, 0

    def close(self) -> None:
        self._database.close()
        if self._copy is not None:
            self._copy.cleanup()


def _pick_definition(texts: list[_Definition], type_hash: str) -> tuple[str, str, bytes | None]:
    """Return text, encoding and bytes of the definition with a hash.

    If no definition has the hash, a definition without hash is returned, or any definition if `type_hash` is empty,
    provided that there is only one. Returns empty values and None otherwise.
    """
    fitting = [one for one in texts if one[0] == type_hash] or [one for one in texts if not (one[0] and type_hash)]
    return fitting[0][1:] if len({one[1:] for one in fitting}) == 1 else ("", "", None)


def _placeholder_topic(key: object, count: int | None = None) -> BagTopic:
    """Return a topic for messages whose topic id is in no row of the topics table, so that they are counted and
    readable as bytes.
    """
    return BagTopic(f"(no topic has id {key!r})", "", count=count)


def _require_own_journal(path: Path, journal: Path) -> None:
    """Raise `BagError` if a journal belongs to several databases: SQLite would delete the file that it names."""
    if journal.is_file():
        with journal.open("rb") as stream:
            stream.seek(-min(len(_JOURNAL_MAGIC), journal.stat().st_size), SEEK_END)
            if stream.read() == _JOURNAL_MAGIC:
                raise BagError(
                    f"{path}: its -journal belongs to several databases; expected a journal of this file only"
                )


def _connect(path: Path, options: str) -> sqlite3.Connection:
    # SQLite is built thread-safe, and each iteration has a cursor of its own.
    # Without a cache of statements: two threads that begin to read at once would get the same one, and mix up its rows.
    return sqlite3.connect(
        f"{path.resolve().as_uri()}?{options}", uri=True, check_same_thread=False, cached_statements=0
    )
