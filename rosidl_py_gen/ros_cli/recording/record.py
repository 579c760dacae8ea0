"""``bag record``: a run from options to the final report."""

from __future__ import annotations

import asyncio
from contextlib import ExitStack
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING, Any

from rosidl_py_gen.bags import BagWriter, SqliteWriter
from rosidl_py_gen.ros_cli import AsyncCommand, terminal_output
from rosidl_py_gen.ros_cli.bag.display import size_text
from rosidl_py_gen.ros_cli.bag.qos_overrides import read_qos_overrides
from rosidl_py_gen.ros_cli.bag.rosbag2_services import serve_rosbag2
from rosidl_py_gen.ros_cli.command_node import CommandNode, NetworkOptions, first_of
from rosidl_py_gen.ros_cli.keyboard import read_keys
from rosidl_py_gen.ros_cli.recording.recorder import Recorder
from rosidl_py_gen.ros_cli.recording.selection import Selection
from rosidl_py_gen.ros_cli.recording.writer import WriterThread

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosidl_py_gen.ros_cli.recording.command import RecordOptions
    from rosidl_py_gen.runtime import Node, QoSProfile


def record_bag(network: NetworkOptions, options: RecordOptions) -> AsyncCommand:
    """Return the command for the options. Raises as `Selection` and `read_qos_overrides`."""
    selection, qos = Selection(options), read_qos_overrides(options.qos_file)
    return AsyncCommand(_record(network, partial(_writer, options), options, selection, qos), endless=True)


def _writer(options: RecordOptions) -> BagWriter | SqliteWriter:
    path = options.output or f"rosbag2_{datetime.now():%Y_%m_%d-%H_%M_%S}"
    packs_files = options.compression_mode == "file"
    common: dict[str, Any] = {
        "split_bytes": options.split_bytes,
        "split_s": options.split_s,
        "compression_mode": options.compression_mode,
        "compression_threads": options.threads or (-1 if packs_files else 0),  # one message is too small for several
        "custom_data": options.custom_data,
    }
    if options.storage == "sqlite3":
        return SqliteWriter(path, **common)
    inside = options.compression or ("zstd" if options.compression_mode == "none" else "none")
    return BagWriter(path, compression="" if inside == "none" else inside, **common)


async def _record(
    network: NetworkOptions,
    create: Callable[[], BagWriter | SqliteWriter],
    options: RecordOptions,
    selection: Selection,
    qos: Mapping[str, QoSProfile],
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
                create(),
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
    handlers: list[tuple[str, str, Callable[[Any], dict[str, Any] | None]]] = [
        ("pause", "Pause", lambda _: recorder.pause()),
        ("resume", "Resume", lambda _: recorder.resume()),
        ("toggle_paused", "TogglePaused", lambda _: recorder.toggle_paused()),
        ("is_paused", "IsPaused", lambda _: {"paused": recorder.is_paused}),
        ("split_bagfile", "SplitBagfile", lambda _: recorder.split()),
    ]
    if snapshots:
        handlers.append(("snapshot", "Snapshot", lambda _: {"success": recorder.snapshot()}))
    serve_rosbag2(node, "~/", handlers)


def _report(writer: WriterThread, recorder: Recorder | None, *, as_json: bool) -> None:
    topics = 0 if recorder is None else len(recorder.recorded)
    received, early = (0, 0) if recorder is None else (recorder.dropped, recorder.early)
    dropped = writer.dropped + received
    if as_json:
        terminal_output.document(
            {"path": str(writer.path), "messages": writer.messages, "topics": topics, "dropped": dropped}
        )
        return
    terminal_output.note(
        f"recorded {writer.messages} messages of {topics} topics, {size_text(writer.bytes)}, in {writer.path}"
    )
    if early:
        terminal_output.note(f"{early} messages arrived before the first time of /clock, and were skipped")
    if writer.dropped and writer.is_snapshot_mode:
        terminal_output.note(f"{writer.dropped} messages are larger than --max-cache-size, and are not in a snapshot")
        dropped = received
    if dropped:
        terminal_output.note(f"{dropped} messages arrived faster than they could be written, and were dropped")
