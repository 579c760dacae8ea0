"""SQL over bags and datasets, by DuckDB: topics are tables, and their columns those of `BagReader.table`.

Decides what becomes a table: the topics that the query names, of bags as a Parquet dataset in a temporary folder, as
DuckDB reads what a query needs of that, several times if it has to, in bounded memory. Names are those of topics,
``"/imu"``, also without the first slash. Every table has a column ``bag`` more.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from functools import partial
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote
from uuid import uuid4

from rosidl_py_gen.bags.common import BagError
from rosidl_py_gen.bags.remote import is_url, unreachable_as_error
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.output import escape_json
from rosidl_py_gen.base.resources import missing_extra_message
from rosidl_py_gen.tables.dataset import TOPIC, StagedDataset
from rosidl_py_gen.tables.output_files import file_system, url_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.bags import BagReader

try:
    import duckdb
except ModuleNotFoundError as missing:
    raise missing_extra_message(missing) or missing from None

_QUOTED = re.compile(r"""["]((?:[^"]|"")*)["]|[']((?:[^']|'')*)[']""")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_UNQUOTED = re.compile(r"\b(?:from|join)\s+(/?[\w~]+(?:/[\w~]+)+|/[\w~]+)", re.IGNORECASE)
_SPACE = r"(?:\s|--[^\n]*(?:\n|\Z)|/\*.*?\*/)"
_LISTING = re.compile(rf"{_SPACE}*show{_SPACE}+(?:all{_SPACE}+)?tables(?:{_SPACE}|;)*", re.IGNORECASE | re.DOTALL)
_NO_NUMBER = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*"|-?(?:NaN|Infinity)')
MEMORY_LIMIT = "1GB"
"""Of DuckDB, which would take four fifths of the memory of the machine."""
_SCHEMA = "topics"
"""Schema of all tables. The one that DuckDB starts with has views of its own, which a topic cannot replace."""
_ROWS = 1000


def is_dataset(place: str) -> bool:
    """Whether a folder, or a URL, is one that `write_dataset` has written."""
    system, path = file_system(place)
    with unreachable_as_error(place):
        return bool(system.isdir(path)) and any(
            one.rstrip("/").rpartition("/")[2].startswith(f"{TOPIC}=") for one in system.ls(path, detail=False)
        )


def named(query: str, topics: Sequence[str]) -> list[str]:
    """Those topics that a query may name: SQL does not look at case, so one that is written as it is comes first."""
    if _LISTING.fullmatch(query):
        return []
    words = {one.replace('""', '"') or two.replace("''", "'") for one, two in _QUOTED.findall(query)}
    words |= set(_WORD.findall(query))
    words.discard("")
    exact = [one for one in topics if one in words or one.removeprefix("/") in words]
    known, words = {one.lower() for one in exact}, {word.lower() for word in words}
    others = [one for one in topics if one.lower() not in known]
    return [*exact, *(one for one in others if one.lower() in words or one.removeprefix("/").lower() in words)]


class Database:
    """Topics of bags and datasets as tables of DuckDB. Use it with ``with``.

    Args:
        memory_limit: of DuckDB, as it writes sizes; sorting, joining and grouping more than that goes through the
            temporary folder.

    Raises:
        BagError: no size, or the names of topics differ in case only, which SQL does not tell apart.
    """

    def __init__(self, memory_limit: str = MEMORY_LIMIT) -> None:
        self._base: Any = duckdb.connect(config={"autoinstall_known_extensions": "false"})
        self._folder = TemporaryDirectory(prefix="rosidl-py-gen-tables-")
        self._base.execute("set enable_progress_bar = false")
        self._base.execute("set python_enable_replacements = false")  # variables of ours are no tables
        self._base.execute(f"create schema {_SCHEMA}; set search_path = '{_SCHEMA}'")
        self._execute(f"set temp_directory = {_text(os.path.join(self._folder.name, 'spilled'))}")
        try:
            self._execute(f"set memory_limit = {_text(memory_limit)}")
        except BagError:
            self.close()
            raise BagError(f'expected a memory limit such as 500MB or 8GiB, found "{memory_limit}"') from None
        self._files: dict[str, list[str]] = {}
        self._known: dict[str, tuple[str, int]] = {}
        self._in_datasets: dict[str, list[str]] = {}

    def add(
        self,
        query: str,
        bags: Mapping[str, BagReader],
        datasets: Iterable[str] = (),
        *,
        on_error: str = "raise",
        progress: Callable[[int], None] | None = None,
    ) -> dict[str, str]:
        """Make the topics known that a query names, of bags by name of the bag; returns those left out, and why.

        Raises:
            BagError: the query cannot be parsed; and, as DecodeError, as `write_dataset`.
        """
        files = [one for place in datasets for one in self._of_dataset(place)]
        topics = dict.fromkeys([*(topic for bag in bags.values() for topic in bag.topics), *(one for one, _ in files)])
        for topic in topics:
            found = [bag.topics[topic] for bag in bags.values() if topic in bag.topics]
            types = ", ".join(sorted({one.type_name for one in found}))
            self._known[topic] = types, sum(one.count or 0 for one in found)
        self._parsed(query)
        wanted = named(query, list(topics))
        for topic, file in files:
            self._in_datasets.setdefault(topic, []).append(file)
            if topic in wanted:
                self._files.setdefault(topic, []).append(file)
        left_out: dict[str, str] = {}
        done = 0
        for name, bag in bags.items():
            mine = [topic for topic in wanted if topic in bag.topics]
            shown = None if progress is None else partial(_shifted, progress, done)
            with StagedDataset(bag, self._folder.name, name, compression="lz4", folder_of=self._number_of) as draft:
                draft.read_bag(mine, False, None, None, on_error, shown)
                draft.publish()
            report = draft.report
            done += sum(bag.topics[topic].count or 0 for topic in mine)
            left_out.update(report.skipped_topics)
            for one in report.files:
                self._files.setdefault(one.topic, []).append(one.path)
        return left_out

    def _number_of(self, topic: str) -> str:
        """Return the name of a topic's folder: a name of any length would not be one of a file."""
        return str([*self._known].index(topic))

    def _of_dataset(self, place: str) -> list[tuple[str, str]]:
        """Topics and files."""
        system, root = file_system(place)
        if not is_url(place):  # without the names above it, in which DuckDB would find patterns, and columns in a=b
            shown = os.path.join(self._folder.name, f"dataset-{uuid4().hex}")
            os.symlink(root, shown)
            root = shown
        begin, found = len(root.rstrip("/")) + 1, []
        with unreachable_as_error(place):
            for path in sorted(system.find(root)):
                key, _, topic = path[begin:].partition("/")[0].partition("=")
                if key == TOPIC and path.endswith(".parquet"):
                    found.append((unquote(topic), url_of(place, path)))
        if is_url(place):
            self._base.register_filesystem(system)
        return found

    def run(self, query: str) -> Result:
        """The result of a query.

        Raises:
            BagError: what DuckDB says of it, or it is none; nothing is run then.
        """
        if _LISTING.fullmatch(query):
            query = self._listing()
        statements = self._parsed(query)
        last = statements[-1].type.name if statements else "nothing"
        if last != "SELECT":
            raise BagError(f"expected a query, such as select count(*) from a topic, got {last}")
        self._make_views()
        return Result(self._base, _asked(lambda: self._base.sql(query), list(self._known)))

    def _parsed(self, query: str) -> list[Any]:
        """The statements of a query."""
        try:
            return _asked(lambda: self._base.extract_statements(query))  # type: ignore[no-any-return]
        except BagError as error:
            for name in _UNQUOTED.findall(_QUOTED.sub(" ", query)):
                near = "" if {name, f"/{name}"} & self._known.keys() else did_you_mean(name, self._known)
                raise BagError(f'{error}; a topic with a slash needs double quotes: from "{name}"{near}') from None
            raise

    def _listing(self) -> str:
        """A query for all topics."""
        rows = []
        for topic, (types, count) in sorted(self._known.items()):
            type_sql, messages = _text(types), str(count)
            if files := self._in_datasets.get(topic):
                listed = f"[{', '.join(map(_text, files))}]"
                metadata = f"parquet_kv_metadata({listed}) where key = 'ros.type'::blob"
                type_sql = type_sql if types else f"(select string_agg(distinct decode(value), ', ') from {metadata})"
                messages += f" + (select sum(num_rows)::bigint from parquet_file_metadata({listed}))"
            rows.append(f"({_text(topic)}, {type_sql}, {messages})")
        values = ", ".join(rows) or "(null, null, null)"
        return f"from (values {values}) as topics(name, type, messages) where name is not null"

    def _make_views(self) -> None:
        names: dict[str, str] = {}
        for topic in self._files:
            other = names.setdefault(topic.lower(), topic)
            if other != topic:
                raise BagError(f"{other} and {topic} are one table in SQL, which does not look at case")
        for topic, files in self._files.items():
            listed = ", ".join(_text(one) for one in files)
            source = f"read_parquet([{listed}], union_by_name=true, hive_partitioning=true, hive_types_autocast=false)"
            self._execute(f"create view {_name(topic)} as select * exclude ({TOPIC}) from {source}")
            short = topic.removeprefix("/")
            if short and short.lower() not in names:
                self._execute(f"create or replace view {_name(short)} as select * from {_name(topic)}")

    def _execute(self, statement: str) -> None:
        _asked(lambda: self._base.execute(statement))

    def close(self) -> None:
        """Remove what was written; may be called twice."""
        self._base.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Result:
    """What a query gives.

    Attributes:
        columns: their names; none when the statement gives nothing.
    """

    def __init__(self, base: Any, found: Any) -> None:
        self._base = base
        self._name = _name(f"result {uuid4().hex}")  # which no topic has
        self.columns: list[str] = [] if found is None else list(found.columns)
        if found is not None:
            _asked(lambda: found.create_view(self._name.strip('"')))

    def rows(self) -> Iterator[list[str]]:
        """Rows as texts, as DuckDB writes them; nothing is an empty one. Raises `BagError`."""
        for row in self._fetched("columns(*)::varchar"):
            yield ["" if one is None else one for one in row]

    def csv_lines(self) -> Iterator[str]:
        """The lines of CSV, first the names of columns; as `write`. Raises `BagError`."""
        self._require_rows()
        yield ",".join(map(_csv, self.columns))
        for row in self._fetched("columns(*)::varchar"):
            yield ",".join(map(_csv, row))

    def json_lines(self) -> Iterator[str]:
        """A line of JSON for each row; NaN and infinities are strings, as in `to_json`. Raises `BagError`."""
        self._require_rows()
        for (text,) in self._fetched(f"to_json({self._name})::varchar"):
            yield escape_json(_NO_NUMBER.sub(_as_string, text) if "NaN" in text or "Infinity" in text else text)

    def _fetched(self, selected: str) -> Iterator[tuple[Any, ...]]:
        if self.columns:
            _asked(lambda: self._base.execute(f"select {selected} from {self._name}"))
            while rows := _asked(lambda: self._base.fetchmany(_ROWS)):
                yield from rows

    def _require_rows(self) -> None:
        if not self.columns:
            raise BagError("this statement has no rows to write")

    def write(self, path: str, form: str) -> None:
        """Write a file: ``csv``, ``json`` (a line for each row) or ``parquet``.

        Raises:
            BagError: as DuckDB says. OSError: the file cannot be written.
        """
        self._require_rows()
        if form != "json":
            _asked(lambda: self._base.execute(f"copy (from {self._name}) to {_text(path)} (format {form})"))
            return
        try:
            with open(path, "x", encoding="utf-8") as stream:
                stream.writelines(f"{line}\n" for line in self.json_lines())
        except BaseException:
            with suppress(OSError):
                os.remove(path)
            raise


def _asked(call: Callable[[], Any], topics: Sequence[str] = ()) -> Any:
    """What a call gives; errors of DuckDB as `BagError`, of a missing table with the topics there are."""
    try:
        return call()
    except (duckdb.Error, RuntimeError) as error:
        said = str(error)
        if isinstance(error, duckdb.OutOfMemoryException):
            said = f"{said.splitlines()[0]}\n--memory-limit is what it may take"
    # Raised here, without the error of DuckDB as its context: that has references to all it was about.
    missing = re.search(r"Table with name (.+?) does not exist", said) if topics else None
    if missing and any(missing[1] in (one, one.removeprefix("/")) for one in topics):
        raise BagError(f"there is no message of {missing[1]}")
    if missing:
        near = did_you_mean(missing[1], topics)
        raise BagError(f"no topic {missing[1]}{near}; there are {', '.join(topics)[:500]}")
    raise BagError(f"DuckDB: {'; '.join(line.strip() for line in said.splitlines() if line.strip(' ^'))}")


def _csv(value: str | None) -> str:
    """A value of CSV as DuckDB writes it: nothing is empty, an empty text quoted."""
    if value is None:
        return ""
    quoted = not value or any(sign in value for sign in ',"\n\r')
    return _name(value) if quoted else value


def _as_string(found: re.Match[str]) -> str:
    return found[0] if found[0].startswith('"') else f'"{found[0]}"'


def _shifted(progress: Callable[[int], None], done: int, count: int) -> None:
    progress(done + count)


def _text(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"


def _name(value: str) -> str:
    return '"' + value.replace('"', '""') + '"'
