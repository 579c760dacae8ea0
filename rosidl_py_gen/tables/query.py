"""SQL queries over bags and datasets with DuckDB, in which topics are tables with the columns of `BagReader.table`.

The topics of bags that a query names are written as a Parquet dataset to a temporary folder: DuckDB reads only the data
that the query needs, several times if necessary, in bounded memory. Tables have the names of topics, ``"/imu"``, also
without the first slash, and an additional column ``bag``.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote
from uuid import uuid4

from rosidl_py_gen.bags import BagError, BagLocation
from rosidl_py_gen.base.extras import Extra
from rosidl_py_gen.base.names import did_you_mean
from rosidl_py_gen.base.terminal_text import escape_json
from rosidl_py_gen.tables.dataset_writer import TOPIC, StagedDataset, file_system, url_of
from rosidl_py_gen.tables.multi_bag import find_bags, names_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from typing_extensions import Self

    from rosidl_py_gen.bags import BagReader

try:
    import duckdb
except ModuleNotFoundError as missing:
    raise Extra.missing_error(missing) or missing from None

_QUOTED_NAME = re.compile(r"""["]((?:[^"]|"")*)["]|[']((?:[^']|'')*)[']""")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_UNQUOTED_TOPIC = re.compile(r"\b(?:from|join)\s+(/?[\w~]+(?:/[\w~]+)+|/[\w~]+)", re.IGNORECASE)
_SPACE = r"(?:\s|--[^\n]*(?:\n|\Z)|/\*.*?\*/)"
_SHOW_TABLES = re.compile(rf"{_SPACE}*show{_SPACE}+(?:all{_SPACE}+)?tables(?:{_SPACE}|;)*", re.IGNORECASE | re.DOTALL)
_NOT_A_NUMBER = re.compile(r'"[^"\\]*(?:\\.[^"\\]*)*"|-?(?:NaN|Infinity)')
MEMORY_LIMIT = "1GB"
"""Default memory limit of DuckDB, which would otherwise use 80 % of the machine's memory."""
_SCHEMA = "topics"
"""DuckDB schema that contains the tables. The default schema has views, which the table of a topic with the same name
could not replace."""
_ROWS_PER_FETCH = 1000


def _is_dataset(place: str) -> bool:
    """Return True if a folder or URL was written by `write_dataset`."""
    system, path = file_system(place)
    with BagLocation(place).unreachable_as_error():
        return bool(system.isdir(path)) and any(
            one.rstrip("/").rpartition("/")[2].startswith(f"{TOPIC}=") for one in system.ls(path, detail=False)
        )


def _topics_in(query: str, topics: Sequence[str]) -> list[str]:
    """Return the topics that a query may name.

    As SQL ignores case, all spellings match, and topics in the same case come first.
    """
    if _SHOW_TABLES.fullmatch(query):
        return []
    words = {one.replace('""', '"') or two.replace("''", "'") for one, two in _QUOTED_NAME.findall(query)}
    words |= set(_WORD.findall(query))
    words.discard("")
    exact = [topic for topic in topics if not words.isdisjoint((topic, topic.removeprefix("/")))]
    known, words = {topic.lower() for topic in exact}, {word.lower() for word in words}
    others = [topic for topic in topics if topic.lower() not in known]
    return [*exact, *(one for one in others if not words.isdisjoint((one.lower(), one.removeprefix("/").lower())))]


class Database:
    """DuckDB database with the topics of bags and datasets as tables; a context manager.

    Sorts, joins and groups that exceed `memory_limit`, such as ``1GB``, use the temporary folder.
    """

    def __init__(self, memory_limit: str = MEMORY_LIMIT) -> None:
        self._connection: Any = duckdb.connect(config={"autoinstall_known_extensions": "false"})
        self._folder = TemporaryDirectory(prefix="rosidl-py-gen-tables-")
        self._connection.execute("set enable_progress_bar = false")
        self._connection.execute("set python_enable_replacements = false")  # Python variables must not become tables
        self._connection.execute(f"create schema {_SCHEMA}; set search_path = '{_SCHEMA}'")
        self._execute(f"set temp_directory = {_literal(os.path.join(self._folder.name, 'spilled'))}")
        try:
            self._execute(f"set memory_limit = {_literal(memory_limit)}")
        except BagError:
            self.close()
            raise BagError(f'expected a memory limit such as 500MB or 8GiB, found "{memory_limit}"') from None
        self._files: dict[str, list[str]] = {}
        self._known: dict[str, tuple[str, int]] = {}
        self._in_datasets: dict[str, list[str]] = {}

    @staticmethod
    def find_sources(places: Iterable[str]) -> tuple[dict[str, str], list[str]]:
        """Return the places of bags by unique names, and the places of datasets.

        The searched places are paths and URLs, which may have ``*``.

        Raises `BagError` if nothing is at one of the places.
        """
        found: list[str] = []
        for place in places:
            if not BagLocation(place).is_url and os.path.exists(place):
                found.append(place)
                continue
            sources, failed = find_bags([place])
            for reason in failed.values():
                raise BagError(reason)
            found += (one.place for one in sources)
        datasets = [place for place in found if _is_dataset(place)]
        return names_of(place for place in found if place not in datasets), datasets

    def add(
        self,
        query: str,
        bags: Mapping[str, BagReader],
        datasets: Iterable[str] = (),
        *,
        on_error: str = "raise",
        progress: Callable[[int, int], None] | None = None,
    ) -> dict[str, str]:
        """Add the topics that a query names as tables, from bags by name and from datasets.

        `progress` is called with the number of messages that are read, and the number of all messages of the topics.

        Returns the topics that were skipped, each with the reason. Raises `BagError` if the query cannot be parsed;
        other errors are as for `write_dataset`.
        """
        files = [entry for place in datasets for entry in self._dataset_files(place)]
        topics = dict.fromkeys([*(topic for bag in bags.values() for topic in bag.topics), *(one for one, _ in files)])
        for topic in topics:
            recorded = [bag.topics[topic] for bag in bags.values() if topic in bag.topics]
            types = ", ".join(sorted({one.type_name for one in recorded}))
            self._known[topic] = types, sum(one.count or 0 for one in recorded)
        self._parse(query)
        selected = _topics_in(query, list(topics))
        for topic, file in files:
            self._in_datasets.setdefault(topic, []).append(file)
            if topic in selected:
                self._files.setdefault(topic, []).append(file)
        recorded_topics = (bag.topics[topic] for bag in bags.values() for topic in selected if topic in bag.topics)
        total = sum(topic.count or 0 for topic in recorded_topics)
        skipped: dict[str, str] = {}
        count = 0
        for name, bag in bags.items():
            own = [topic for topic in selected if topic in bag.topics]
            on_count = None if progress is None else lambda own_count, before=count: progress(before + own_count, total)
            with StagedDataset(bag, self._folder.name, name, compression="lz4", folder_of=self._folder_of) as dataset:
                dataset.read_bag(own, False, None, None, on_error, on_count)
                dataset.commit()
            count += sum(bag.topics[topic].count or 0 for topic in own)
            skipped.update(dataset.report.skipped_topics)
            for file_report in dataset.report.files:
                self._files.setdefault(file_report.topic, []).append(file_report.path)
        return skipped

    def _folder_of(self, topic: str) -> str:
        """Return the number that is the name of a topic's folder, because the topic may be too long for a file name."""
        return str([*self._known].index(topic))

    def _dataset_files(self, place: str) -> list[tuple[str, str]]:
        system, root = file_system(place)
        if not BagLocation(place).is_url:
            # Hides parent folders, whose names DuckDB would parse for patterns, and a=b for columns.
            link = os.path.join(self._folder.name, f"dataset-{uuid4().hex}")
            os.symlink(root, link)
            root = link
        begin, files = len(root.rstrip("/")) + 1, []
        with BagLocation(place).unreachable_as_error():
            for path in sorted(system.find(root)):
                key, _, topic = path[begin:].partition("/")[0].partition("=")
                if key == TOPIC and path.endswith(".parquet"):
                    files.append((unquote(topic), url_of(place, path)))
        if BagLocation(place).is_url:
            self._connection.register_filesystem(system)
        return files

    def run(self, query: str) -> Result:
        """Return the result of a SQL query over the added topics.

        Raises:
            BagError: DuckDB reports an error, the statement is not a query, or names of topics differ only in case.
        """
        if _SHOW_TABLES.fullmatch(query):
            query = self._topic_list_query()
        statements = self._parse(query)
        last = statements[-1].type.name if statements else "nothing"
        if last != "SELECT":
            raise BagError(f"expected a query, such as select count(*) from a topic, got {last}")
        self._make_views()
        return Result(self._connection, _call(lambda: self._connection.sql(query), list(self._known)))

    def _parse(self, query: str) -> list[Any]:
        try:
            return _call(lambda: self._connection.extract_statements(query))  # type: ignore[no-any-return]
        except BagError as error:
            for name in _UNQUOTED_TOPIC.findall(_QUOTED_NAME.sub(" ", query)):
                near = "" if {name, f"/{name}"} & self._known.keys() else did_you_mean(name, self._known)
                raise BagError(f'{error}; a topic with a slash needs double quotes: from "{name}"{near}') from None
            raise

    def _topic_list_query(self) -> str:
        rows = []
        for topic, (types, count) in sorted(self._known.items()):
            type_sql, messages = _literal(types), str(count)
            if files := self._in_datasets.get(topic):
                file_list = f"[{', '.join(map(_literal, files))}]"
                metadata = f"parquet_kv_metadata({file_list}) where key = 'ros.type'::blob"
                type_sql = type_sql if types else f"(select string_agg(distinct decode(value), ', ') from {metadata})"
                messages += f" + (select sum(num_rows)::bigint from parquet_file_metadata({file_list}))"
            rows.append(f"({_literal(topic)}, {type_sql}, {messages})")
        values = ", ".join(rows) or "(null, null, null)"
        return f"from (values {values}) as topics(name, type, messages) where name is not null"

    def _make_views(self) -> None:
        names: dict[str, str] = {}
        for topic in self._files:
            other = names.setdefault(topic.lower(), topic)
            if other != topic:
                raise BagError(f"{other} and {topic} are one table in SQL, which ignores case")
        for topic, files in self._files.items():
            file_list = ", ".join(map(_literal, files))
            source = (
                f"read_parquet([{file_list}], union_by_name=true, hive_partitioning=true, hive_types_autocast=false)"
            )
            self._execute(f"create view {_identifier(topic)} as select * exclude ({TOPIC}) from {source}")
            short = topic.removeprefix("/")
            if short and short.lower() not in names:
                self._execute(f"create or replace view {_identifier(short)} as select * from {_identifier(topic)}")

    def _execute(self, statement: str) -> None:
        _call(lambda: self._connection.execute(statement))

    def close(self) -> None:
        """Close the database and remove its temporary files; may be called repeatedly."""
        self._connection.close()
        self._folder.cleanup()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Result:
    """Result of a SQL query, with the names of its columns."""

    def __init__(self, connection: Any, relation: Any) -> None:
        self._connection = connection
        self._name = _identifier(f"result {uuid4().hex}")  # not the name of a topic
        self.columns: list[str] = list(relation.columns)
        _call(lambda: relation.create_view(self._name.strip('"')))

    def rows(self) -> Iterator[list[str]]:
        """Yield rows of a query result as texts in DuckDB's format, with "" for null.

        Raises `BagError` if DuckDB reports an error.
        """
        for row in self._fetch("columns(*)::varchar"):
            yield ["" if one is None else one for one in row]

    def csv_lines(self) -> Iterator[str]:
        """Yield lines of CSV, the first with the column names; raises `BagError` if DuckDB reports an error."""
        yield ",".join(map(_csv, self.columns))
        for row in self._fetch("columns(*)::varchar"):
            yield ",".join(map(_csv, row))

    def json_lines(self) -> Iterator[str]:
        """Yield each row as a line of JSON; NaN and infinities are strings, as in `to_json`.

        Raises `BagError` if DuckDB reports an error.
        """
        for (text,) in self._fetch(f"to_json({self._name})::varchar"):
            yield escape_json(_NOT_A_NUMBER.sub(_as_string, text) if "NaN" in text or "Infinity" in text else text)

    def _fetch(self, columns: str) -> Iterator[tuple[Any, ...]]:
        _call(lambda: self._connection.execute(f"select {columns} from {self._name}"))
        while rows := _call(lambda: self._connection.fetchmany(_ROWS_PER_FETCH)):
            yield from rows

    def write(self, path: str, form: str) -> None:
        """Write the result to a file as ``csv``, ``json`` (a line for each row) or ``parquet``.

        Raises:
            BagError: DuckDB reports an error.
            OSError: the ``json`` file exists, or cannot be written.
        """
        if form != "json":
            _call(lambda: self._connection.execute(f"copy (from {self._name}) to {_literal(path)} (format {form})"))
            return
        with open(path, "x", encoding="utf-8") as stream:
            try:
                stream.writelines(f"{line}\n" for line in self.json_lines())
                stream.flush()
            except BaseException:
                with suppress(OSError):
                    os.remove(path)
                raise


def _call(call: Callable[[], Any], topics: Sequence[str] = ()) -> Any:
    """Call a function of DuckDB and return its result; errors of DuckDB become `BagError`.

    If a table is missing, the error names the known topics.
    """
    try:
        return call()
    except (duckdb.Error, RuntimeError) as error:
        text = str(error)
        if isinstance(error, duckdb.OutOfMemoryException):
            text = f"{text.splitlines()[0]}\n--memory-limit raises the limit"
    # Raised outside of the handler: the error of DuckDB as context would keep references to all data of the call.
    missing = re.search(r"Table with name (.+?) does not exist", text) if topics else None
    if missing and any(missing[1] in (one, one.removeprefix("/")) for one in topics):
        raise BagError(f"{missing[1]} has no messages")
    if missing:
        near = did_you_mean(missing[1], topics)
        raise BagError(f"no topic {missing[1]}{near}; there are {', '.join(topics)[:500]}")
    raise BagError(f"DuckDB: {'; '.join(line.strip() for line in text.splitlines() if line.strip(' ^'))}")


def _csv(value: str | None) -> str:
    """Return a value as DuckDB writes it to a CSV file: null is empty, an empty text is quoted."""
    if value is None:
        return ""
    needs_quotes = not value or any(sign in value for sign in ',"\n\r')
    return _identifier(value) if needs_quotes else value


def _as_string(match: re.Match[str]) -> str:
    return match[0] if match[0].startswith('"') else f'"{match[0]}"'


def _literal(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"


def _identifier(value: str) -> str:
    return '"' + value.replace('"', '""') + '"'
