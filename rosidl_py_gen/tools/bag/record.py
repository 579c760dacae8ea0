"""``bag record``.

Decides what is recorded. A topic is subscribed to before its definition is known, so that nothing is missed while peers
are asked.
"""

from __future__ import annotations

import asyncio
import re
from contextlib import suppress
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import get_message
from rosidl_py_gen.bags import BagTopic, BagWriter
from rosidl_py_gen.bags.metadata import qos_text
from rosidl_py_gen.bags.writer import topic_of
from rosidl_py_gen.errors import ClosedError, RosidlError
from rosidl_py_gen.tools import Job, ToolError, printing, types
from rosidl_py_gen.tools.bag.part import progress, size_text
from rosidl_py_gen.tools.bag.writer import WriterThread
from rosidl_py_gen.tools.commands.bag import RecordOptions
from rosidl_py_gen.tools.follow import Follow
from rosidl_py_gen.tools.names import full_topic_name, is_hidden
from rosidl_py_gen.tools.session import Network, Session, first_of, now_s

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

_DEPTH = 1000
"""Messages that may come while this process does something else."""
_PROGRESS_S = 0.5


def run(network: Network, options: RecordOptions) -> Job:
    """What the command does."""
    wanted = _Wanted(options)
    path = options.output or f"rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}"
    inside = "" if options.compression == "none" else options.compression
    create = partial(BagWriter, path, compression=inside, split_bytes=options.split_bytes, split_s=options.split_s)
    return Job(_record(network, create, options, wanted), endless=True)


class _Wanted:
    """Which topics are to be recorded; patterns that are none raise `ToolError`."""

    def __init__(self, options: RecordOptions) -> None:
        self._options = options
        self._regex = None if options.regex is None else _pattern(options.regex)
        self._exclude = [_pattern(text) for text in options.exclude]

    def has(self, topic: str, named: Sequence[str]) -> bool:
        """Whether a topic is, by its full name as all that were named."""
        if topic in named:
            return True
        if (is_hidden(topic) and not self._options.hidden) or any(one.search(topic) for one in self._exclude):
            return False
        return self._options.everything or (self._regex is not None and self._regex.search(topic) is not None)


def _pattern(text: str) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except re.error as error:
        raise ToolError(f'"{text}" is no regular expression: {error}') from None


async def _record(network: Network, create: Callable[[], BagWriter], options: RecordOptions, wanted: _Wanted) -> int:
    loop = asyncio.get_running_loop()
    failed = asyncio.Event()
    writer: WriterThread | None = None
    recorder: _Recorder | None = None
    try:
        async with Session(network) as session:  # first, so that no bag is made where nothing can be heard
            writer = WriterThread(create(), partial(loop.call_soon_threadsafe, failed.set))
            recorder = _Recorder(session, writer, options, wanted)
            with progress() as show:
                end = () if options.duration_s is None else (asyncio.sleep(options.duration_s),)
                await first_of(failed.wait(), recorder.follow(), recorder.report(show), *end)
    finally:
        if writer is not None:
            writer.end()
            _say_end(writer, recorder, as_json=options.as_json)
    return 0


def _say_end(writer: WriterThread, recorder: _Recorder | None, *, as_json: bool) -> None:
    topics = 0 if recorder is None else len(recorder.recorded)
    dropped = writer.dropped + (0 if recorder is None else recorder.dropped)
    if as_json:
        printing.document({"path": str(writer.path), "messages": writer.messages, "topics": topics, "dropped": dropped})
        return
    printing.note(
        f"recorded {writer.messages} messages of {topics} topics, {size_text(writer.bytes)}, in {writer.path}"
    )
    if dropped:
        printing.note(f"{dropped} messages came faster than they could be written, and are missing")


class _Recorder:
    """Subscribes to what is wanted and hands it to the writer."""

    def __init__(self, session: Session, writer: WriterThread, options: RecordOptions, wanted: _Wanted) -> None:
        self._session = session
        self._node = session.node
        self._writer = writer
        self._options = options
        self._wanted = wanted
        self._named = [full_topic_name(session, topic) for topic in options.topics]
        self._followed: list[Follow] = []
        self._has_looked = False
        self._compiling = asyncio.Lock()
        self._tasks: list[asyncio.Task[None]] = []
        self.recorded: set[str] = set()
        """Topics that are recorded."""

    @property
    def dropped(self) -> int:
        """Messages that were not taken in time."""
        return sum(one.dropped for one in self._followed)

    async def follow(self) -> None:
        """Record what is there, and what appears, for ever."""
        try:
            await self._session.wait_until_quiet()
            self._look()
            for name in self._named:
                if name not in self.recorded:
                    if self._options.no_discovery:
                        raise ToolError(f"nobody publishes {name}, and --no-discovery waits for nobody")
                    printing.note(f"nobody publishes {name} yet; waiting for it")
            async for _ in self._node.graph_changes():
                self._look()
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    async def report(self, show: Any) -> None:
        """Say how far it is, for ever."""
        began = now_s()
        while True:
            dropped = f", {self.dropped} dropped" if self.dropped else ""
            text = f"{self._writer.messages} messages of {len(self.recorded)} topics, {size_text(self._writer.bytes)}"
            show(f"recording for {now_s() - began:.0f} s: {text}{dropped}; Ctrl-C ends it")
            await asyncio.sleep(_PROGRESS_S)
            for task in self._tasks:
                if task.done():
                    task.result()  # its failure is ours

    def _look(self) -> None:
        """Begin with new topics."""
        if self._has_looked and self._options.no_discovery:
            return
        self._has_looked = True
        for name, kinds in self._node.get_topic_names_and_types():
            if name not in self.recorded and self._wanted.has(name, self._named) and self._node.count_publishers(name):
                self.recorded.add(name)
                if len(kinds) > 1:
                    printing.note(f"{name} has several types, {', '.join(kinds)}: recording those of {kinds[0]}")
                self._tasks.append(asyncio.ensure_future(self._record(name, kinds[0])))

    async def _record(self, topic: str, type_name: str) -> None:
        publishers = self._node.get_publishers_info_by_topic(topic)
        qos = [one.qos_profile for one in publishers if one.topic_type == type_name]
        cls, put = types.opaque_class(self._session, topic, type_name), self._writer.put
        following = Follow(self._node, topic, cls, depth=_DEPTH, note=lambda text: printing.note(f"{topic}: {text}"))
        async with following as messages:
            self._followed.append(messages)
            self._writer.add_topic(await self._described(topic, type_name, qos))
            if not self._options.as_json:
                printing.note(f"recording {topic} [{type_name}]")
            with suppress(ClosedError):  # the node ends
                while True:
                    data, info = await messages.receive_with_info()
                    put(topic, data, info.received_timestamp_ns, max(0, info.source_timestamp_ns))

    async def _described(self, topic: str, type_name: str, qos: Sequence[Any]) -> BagTopic:
        """The topic as the bag keeps it; without definition when it cannot be found."""
        async with self._compiling:
            with suppress(RosidlError):  # in a thread: what arrives meanwhile is to have its own time
                await asyncio.to_thread(get_message, type_name, path=tuple(self._options.paths))
        try:
            cls = await types.message_class(self._session, topic, type_name, self._options.paths)
            return topic_of(topic, cls, qos)
        except RosidlError as error:
            printing.note(f"{topic}: recorded without a definition of {type_name}: {error}")
        hashes = [one.topic_type_hash for one in self._node.get_publishers_info_by_topic(topic)]
        return BagTopic(topic, type_name, type_hash=(hashes or [""])[0], offered_qos=qos_text(qos))
