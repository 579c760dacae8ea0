"""Recorder, which selects topics, receives messages and passes them to the writer; the run of ``bag record``.

A topic belongs to a service, an action or itself. Exclusion precedes inclusion. A topic is subscribed to before its
definition is known, so that no message is missed while the definition is requested from peers.
Source: rosbag2's design documents of recording services and actions, and its topic filter.
"""

from __future__ import annotations

import asyncio
from contextlib import ExitStack, suppress
from datetime import datetime
from functools import partial
from shlex import quote
from typing import TYPE_CHECKING, Any

from rosidl_py_gen import compile_definition, get_message, type_hash, type_name
from rosidl_py_gen.bags import BagTopic, OfferedQoS, topic_of
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.terminal_text import pluralize, print_next_step
from rosidl_py_gen.cdr.message import opaque_message_class
from rosidl_py_gen.command_support import (
    CommandError,
    CommandNode,
    NetworkOptions,
    first_of,
    interface_class,
    opaque_class,
    terminal_output,
)
from rosidl_py_gen.errors import ClosedError, InvalidNameError, RosidlError, TypeNotFoundError
from rosidl_py_gen.ros_cli import AsyncCommand
from rosidl_py_gen.ros_cli.bag.convert import create_bag
from rosidl_py_gen.ros_cli.bag.player_recorder import read_keys, read_qos_overrides
from rosidl_py_gen.ros_cli.bag.reading import size_text
from rosidl_py_gen.ros_cli.bag.rosbag2_services import serve_rosbag2
from rosidl_py_gen.ros_cli.bag.topic_owner import TopicOwner, topic_owner
from rosidl_py_gen.ros_cli.options import compile_pattern
from rosidl_py_gen.ros_cli.recording.writer import WriterThread
from rosidl_py_gen.runtime import AdaptiveSubscription, SecurityError, validate_full_name
from rosidl_py_gen.type_loading import definition_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from rosidl_py_gen.bags import BagWriter, SqliteWriter
    from rosidl_py_gen.cdr import Message
    from rosidl_py_gen.ros_cli.recording import RecordOptions
    from rosidl_py_gen.runtime import Node, QoSProfile


def owner_of(topic: str, type_name: str) -> TopicOwner:
    """Return the owner of a topic: the service or action that it belongs to, or else the topic itself."""
    kind, name, _ = topic_owner(topic, type_name)
    return TopicOwner(kind, name)


class Selection:
    """Topics that the options of ``bag record`` select.

    Raises `CommandError` for invalid patterns, `InvalidNameError` for invalid names.
    """

    def __init__(self, options: RecordOptions) -> None:
        topics = [*options.topics, *options.more_topics]
        included = {"topic": topics, "service": options.services, "action": options.actions}
        self.named = [TopicOwner(kind, name) for kind, names in included.items() for name in _full_names(names)]
        """Topics, services and actions that the user has named, hidden or not."""
        self._excluded = {
            "topic": {*_full_names(options.exclude_topics)},
            "service": {*_full_names(options.exclude_services)},
            "action": {*_full_names(options.exclude_actions)},
        }
        self._all = {
            "topic": options.everything or options.all_topics,
            "service": options.everything or options.all_services,
            "action": options.everything or options.all_actions,
        }
        self._types = {str(RosName.parse(name, "msg")) for name in options.topic_types}
        self._excluded_types = {str(RosName.parse(name, "msg")) for name in options.exclude_topic_types}
        self._regex = None if options.regex is None else compile_pattern(options.regex, "--regex")
        self._exclude_patterns = [compile_pattern(text, "--exclude") for text in options.exclude]
        self._hidden = options.hidden

    def takes(self, topic: str, type_name: str) -> bool:
        """Return True if the options select a topic, so that it is recorded."""
        if TopicOwner("topic", topic) in self.named:  # also if it belongs to a service or action
            return not self._is_excluded(TopicOwner("topic", topic), type_name)
        owner = owner_of(topic, type_name)
        if self._is_excluded(owner, type_name):
            return False
        is_wanted = (
            self._all[owner.kind]
            or owner in self.named
            or (self._regex is not None and self._regex.search(owner.name) is not None)
        )
        if owner.kind != "topic":
            return is_wanted
        return (is_wanted or type_name in self._types) and (self._hidden or not CommandNode.is_hidden(topic))

    def _is_excluded(self, owner: TopicOwner, type_name: str) -> bool:
        return (
            owner.name in self._excluded[owner.kind]
            or any(one.search(owner.name) for one in self._exclude_patterns)
            or (owner.kind == "topic" and type_name in self._excluded_types)
        )


def _full_names(names: Iterable[str]) -> list[str]:
    full_names = [name if name.startswith("/") else f"/{name}" for name in names]
    for name in full_names:
        validate_full_name(name)
    return full_names


_DEPTH = 1000
"""Depth of a subscription's queue: number of messages that may arrive while the process is busy without being dropped.
"""
_PROGRESS_INTERVAL_S = 0.5
_MISSING = {
    "topic": "{}",
    "service": "events of the service {}, whose introspection may be off,",
    "action": "anything of the action {}",
}


class Recorder:
    """Recorder of the selected topics.

    It subscribes with the QoS given by the user, or with the QoS that publishers offer.
    """

    def __init__(
        self,
        command_node: CommandNode,
        writer: WriterThread,
        options: RecordOptions,
        selection: Selection,
        qos: Mapping[str, QoSProfile],
    ) -> None:
        self._command_node = command_node
        self._node = command_node.node
        self._writer = writer
        self._options = options
        self._selection = selection
        self._qos = qos
        self._subscriptions: list[AdaptiveSubscription[bytes]] = []
        self._compile_lock = asyncio.Lock()
        self._tasks: list[asyncio.Task[None]] = []
        self._owners: set[TopicOwner] = set()  # of what is recorded
        self.is_paused = options.start_paused
        """True while received messages are skipped instead of recorded."""
        self.recorded: set[str] = set()
        """Names of recorded topics."""
        self._refused: set[str] = set()
        self.early = 0
        """Number of messages that were skipped because they arrived before the first time of ``/clock``."""

    def set_paused(self, is_paused: bool) -> None:
        """Skip received messages from now on if `is_paused`, or else record them."""
        if is_paused != self.is_paused:
            self.is_paused = is_paused
            self._note("paused" if is_paused else "recording resumed")

    def toggle_paused(self) -> None:
        """Pause recording, or resume recording that is paused."""
        self.set_paused(not self.is_paused)

    def split(self) -> None:
        """Continue the bag in a new file; print a note if the bag is a single file."""
        if not self._writer.split():
            self._note(f"{self._writer.path} is one file; only a folder can be split")

    def snapshot(self) -> bool:
        """Write the messages retained for a snapshot; returns False while an earlier snapshot is being written."""
        is_done = self._writer.snapshot()
        self._note(
            f"snapshot into {self._writer.path}" if is_done else "no snapshot: the previous one is still being written"
        )
        return is_done

    def _note(self, text: str) -> None:
        if not self._options.as_json:
            terminal_output.note(text)

    @property
    def dropped(self) -> int:
        """Number of messages that the subscriptions dropped, as they arrived faster than they were read."""
        return sum(one.dropped for one in self._subscriptions)

    @property
    def incompatible(self) -> int:
        """Number of messages that were dropped because their publisher has another definition than the bag's topic."""
        return sum(one.incompatible_dropped for one in self._subscriptions)

    async def run(self) -> None:
        """Record existing and new topics until cancelled."""
        try:
            await self._command_node.wait_for_discovery()
            self._subscribe_to_new()
            for named in self._selection.named:
                if named not in self._owners:
                    what = _MISSING[named.kind].format(named.name)
                    if self._options.no_discovery:
                        raise CommandError(f"no publisher of {what}, and --no-discovery does not wait for one")
                    terminal_output.note(f"no publisher of {what} yet; waiting for it")
            if self._options.no_discovery:
                await asyncio.Event().wait()
            pause_s = self._options.polling_ms / 1000
            await asyncio.sleep(pause_s)
            self._subscribe_to_new()
            async for _ in self._node.graph_changes():
                self._subscribe_to_new()
                await asyncio.sleep(pause_s)
        finally:
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)

    async def report(self, show: Any) -> None:
        """Display the progress of recording until cancelled; raises the error of a topic that failed."""
        began = self._command_node.now_s()
        while True:
            dropped_count = self.dropped + self.incompatible
            dropped = f", {dropped_count} dropped" if dropped_count else ""
            counts = f"{pluralize(self._writer.messages, 'message')} of {pluralize(len(self.recorded), 'topic')}"
            text = f"{counts}, {size_text(self._writer.bytes)}"
            retained = self._writer.retained_count
            snapshot = "" if retained is None else f", {pluralize(retained, 'message')} retained for a snapshot"
            what = "paused after" if self.is_paused else "recording for"
            show(f"{what} {self._command_node.now_s() - began:.0f} s: {text}{snapshot}{dropped}; Ctrl-C ends recording")
            await asyncio.sleep(_PROGRESS_INTERVAL_S)
            for task in self._tasks:
                if task.done():
                    task.result()  # raises its error

    def _subscribe_to_new(self) -> None:
        for name, kinds in self._node.get_topic_names_and_types():
            is_wanted = name not in self.recorded and self._selection.takes(name, kinds[0])
            if not (is_wanted and self._has_required_endpoints(name) and self._is_valid(name, kinds[0])):
                continue
            self.recorded.add(name)
            self._owners |= {TopicOwner("topic", name), owner_of(name, kinds[0])}
            if len(kinds) > 1:
                terminal_output.note(f"{name} has several types, {', '.join(kinds)}: recording messages of {kinds[0]}")
            self._tasks.append(asyncio.ensure_future(self._record(name, kinds[0])))

    def _is_valid(self, topic: str, kind: str) -> bool:
        if topic in self._refused:
            return False
        try:
            validate_full_name(topic)
            RosName.parse(kind)
        except InvalidNameError as error:
            self._refused.add(topic)
            terminal_output.note(f"skipped a topic: {str(error).splitlines()[0]}")
            return False
        return True

    def _has_required_endpoints(self, topic: str) -> bool:
        if self._options.no_leaves and not self._node.count_subscribers(topic):
            return False
        return self._options.unpublished or self._node.count_publishers(topic) > 0

    async def _record(self, topic: str, kind: str) -> None:
        publishers = self._node.get_publishers_info_by_topic(topic)
        offered = [one.qos_profile for one in publishers if one.topic_type == kind]
        cls = opaque_class(self._command_node, topic, kind)
        try:
            following: AdaptiveSubscription[bytes] = AdaptiveSubscription(
                self._node,
                topic,
                cls,
                qos=self._qos.get(topic),
                depth=_DEPTH,
                raw=True,
                note=lambda text: terminal_output.note(f"{topic}: {text}"),
            )
        except SecurityError as error:  # the other topics are recorded
            self.recorded.discard(topic)
            self._refused.add(topic)
            terminal_output.note(f"skipped {topic}: {error}")
            return
        async with following as messages:
            self._subscriptions.append(messages)
            bag_topic = await self._bag_topic(topic, kind, offered)
            self._writer.add_topic(bag_topic)
            if bag_topic.type_hash and not type_hash(cls):
                messages.set_definition(opaque_message_class(kind, bag_topic.type_hash))
            self._note(f"recording {topic} [{kind}]")
            with suppress(ClosedError):  # the node ends
                while True:
                    data, info = await messages.receive_with_info()
                    self._handle_message(topic, data, info.received_timestamp_ns, max(0, info.source_timestamp_ns))

    def _handle_message(self, topic: str, data: bytes, received_ns: int, published_ns: int) -> None:
        if self.is_paused:
            return
        if self._options.sim_time:
            received_ns = self._node.clock.now_ns()
            if received_ns <= 0:
                self.early += 1
                return
        self._writer.enqueue(topic, data, received_ns, published_ns)

    async def _bag_topic(self, topic: str, kind: str, qos: Sequence[Any]) -> BagTopic:
        async with self._compile_lock:
            with suppress(RosidlError):  # in a thread, so that messages get their own times
                await asyncio.to_thread(get_message, kind, path=tuple(self._options.paths))
        try:
            cls = await interface_class(self._command_node, "topic", topic, kind, self._options.paths)
            return await self._topic_of(topic, cls, qos)
        except RosidlError as error:
            terminal_output.note(f"{topic}: recorded without a definition of {kind}: {error}")
        hashes = [one.topic_type_hash for one in self._node.get_publishers_info_by_topic(topic)]
        return BagTopic(topic, kind, type_hash=(hashes or [""])[0], offered_qos=OfferedQoS(qos).text)

    async def _topic_of(self, topic: str, cls: type[Message], qos: Sequence[Any]) -> BagTopic:
        """Return the topic of the bag with its definition, which for a topic of an action is the whole action."""
        try:
            return topic_of(topic, cls, qos)
        except TypeNotFoundError:
            owner = owner_of(topic, type_name(cls))
            if owner.kind != "action":
                raise
            action = await interface_class(self._command_node, "action", owner.name, paths=self._options.paths)
            text = definition_text(action)
            if type_hash(compile_definition(type_name(cls), text)) != type_hash(cls):
                raise
            return BagTopic(topic, type_name(cls), text, type_hash=type_hash(cls), offered_qos=OfferedQoS(qos).text)


def record_bag(network: NetworkOptions, options: RecordOptions) -> AsyncCommand:
    """Return a command that records; raises `CommandError`, `InvalidNameError` or OSError for wrong options."""
    selection, qos = Selection(options), read_qos_overrides(options.qos_file)
    return AsyncCommand(_record(network, options, selection, qos), endless=True)


def _create_bag(options: RecordOptions) -> BagWriter | SqliteWriter:
    return create_bag(
        options.output or f"rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}",
        options.storage,
        options.compression or ("zstd" if options.compression_mode == "none" else "none"),
        split_bytes=options.split_bytes,
        split_s=options.split_s,
        compression_mode=options.compression_mode,
        # One message is too small for several threads.
        compression_threads=options.threads or (-1 if options.compression_mode == "file" else 0),
        custom_data=options.custom_data,
    )


async def _record(
    network: NetworkOptions, options: RecordOptions, selection: Selection, qos: Mapping[str, QoSProfile]
) -> None:
    loop = asyncio.get_running_loop()
    failed = asyncio.Event()
    writer: WriterThread | None = None
    recorder: Recorder | None = None
    # Peers get the types of the services from this node; rosbag2_interfaces need not be installed.
    overrides = {"start_type_description_service": True, "use_sim_time": options.sim_time}
    try:
        # The network first, so that no bag is created if it fails.
        async with CommandNode(network, name=options.node_name, parameter_overrides=overrides) as command_node:
            writer = WriterThread(
                _create_bag(options),
                partial(loop.call_soon_threadsafe, failed.set),
                max_bytes=options.cache_bytes,
                snapshots=options.snapshots,
            )
            recorder = Recorder(command_node, writer, options, selection, qos)
            _serve(command_node.node, recorder, snapshots=options.snapshots)
            with ExitStack() as resources:
                if not options.no_keys and resources.enter_context(read_keys({"space": recorder.toggle_paused})):
                    terminal_output.note("space pauses and resumes")
                if options.start_paused:
                    terminal_output.note("paused from the start")
                show = resources.enter_context(terminal_output.StatusLine()).show
                end = () if options.duration_s is None else (asyncio.sleep(options.duration_s),)
                await first_of(failed.wait(), recorder.run(), recorder.report(show), *end)
    finally:
        if writer is not None:
            writer.end()
            _report(writer, recorder, as_json=options.as_json)


def _serve(node: Node, recorder: Recorder, *, snapshots: bool) -> None:
    handlers: dict[str, Callable[[Any], dict[str, Any] | None]] = {
        "pause": lambda _: recorder.set_paused(True),
        "resume": lambda _: recorder.set_paused(False),
        "toggle_paused": lambda _: recorder.toggle_paused(),
        "is_paused": lambda _: {"paused": recorder.is_paused},
        "split_bagfile": lambda _: recorder.split(),
    }
    if snapshots:
        handlers["snapshot"] = lambda _: {"success": recorder.snapshot()}
    serve_rosbag2(node, "~/", handlers)


def _report(writer: WriterThread, recorder: Recorder | None, *, as_json: bool) -> None:
    topics = received = early = incompatible = 0
    if recorder is not None:
        topics, received, early = len(recorder.recorded), recorder.dropped, recorder.early
        incompatible = recorder.incompatible
    dropped = writer.dropped + received
    if as_json:
        counts = {"messages": writer.messages, "topics": topics, "dropped": dropped + incompatible}
        terminal_output.document({"path": str(writer.path), **counts})
        return
    terminal_output.note(
        f"recorded {pluralize(writer.messages, 'message')} of {pluralize(topics, 'topic')}, "
        f"{size_text(writer.bytes)}, in {writer.path}"
    )
    if early:
        terminal_output.note(f"skipped {pluralize(early, 'message')} from before the first time of /clock")
    if writer.dropped and writer.retained_count is not None:
        terminal_output.note(
            f"{pluralize(writer.dropped, 'message')} larger than --max-cache-size, hence not in a snapshot"
        )
        dropped = received
    if dropped:
        terminal_output.note(f"dropped {pluralize(dropped, 'message')}: more arrived than could be written")
    if incompatible:
        terminal_output.note(f"dropped {pluralize(incompatible, 'message')} of other definitions of their type")
    print_next_step("rosidl-py bag info", quote(str(writer.path)))
