"""Bags written and read by this package, by mcap, by mcap-ros2-support and by rosbags have equal values."""

from __future__ import annotations

import asyncio
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory as TheirFactory
from mcap_ros2.writer import Writer as TheirWriter
from rosbags.rosbag2 import Reader as RosbagsReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import Imu
from std_msgs.msg import Bool, String
from std_msgs.msg import UInt8MultiArray as Bytes
from support.bag_samples import file_size_limit, require_error, write_strings

from rosidl_py_gen import compile_definition, get_message, type_hash
from rosidl_py_gen.bags import BagError, BagMessage, BagReader, BagTopic, BagWriter, DecoderFactory
from rosidl_py_gen.bags.metadata import OfferedQoS
from rosidl_py_gen.runtime import Durability, QoSProfile
from rosidl_py_gen.runtime.loop.event_loop import VirtualTimeLoop

S = 1_000_000_000


def imu(number: int) -> Any:
    sample = Imu()
    sample.header.frame_id = f"imu_{number}"
    sample.header.stamp.sec, sample.header.stamp.nanosec = number, 5
    sample.linear_acceleration.x = number / 2
    sample.orientation_covariance[:] = number
    return sample


def write_some(path: Path, **options: Any) -> None:
    with BagWriter(path, **options) as writer:
        for number in range(10):
            writer.write("/imu", imu(number), S * number)
            writer.write("/chatter", String(data=f"hällo {number}"), S * number + 1, S * number)


@pytest.fixture(params=["file.mcap", "folder"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / str(request.param)
    write_some(path)
    return path


def test_written_messages_are_read_back(bag: Path) -> None:
    with BagReader(bag) as reader:
        assert list(reader.topics) == ["/chatter", "/imu"]
        topic = reader.topics["/imu"]
        assert (topic.type_name, topic.count, topic.type_hash) == ("sensor_msgs/msg/Imu", 10, type_hash(Imu))
        items = list(reader)
        assert [item.log_time for item in items] == sorted(item.log_time for item in items)
        assert [item.message for item in items if item.topic == "/imu"] == [imu(number) for number in range(10)]
        assert type(items[0].message) is Imu
        chosen = list(reader.messages("/chatter", start_ns=3 * S, end_ns=5 * S))
        assert [(item.message.data, item.publish_time) for item in chosen] == [("hällo 3", 3 * S), ("hällo 4", 4 * S)]
        raw = next(iter(reader.messages("/chatter", raw=True)))
        assert String.decode(raw.message).data == "hällo 0"


@pytest.mark.parametrize("compression", ["", "lz4", "zstd"])
def test_mcap_ros2_support_decodes_bags_like_our_decoder_factory(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "bag.mcap"
    write_some(path, compression=compression)
    with path.open("rb") as one, path.open("rb") as two:
        ours = make_reader(one, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        theirs = make_reader(two, validate_crcs=True, decoder_factories=[TheirFactory()]).iter_decoded_messages()
        counts = {"/imu": 0, "/chatter": 0}
        for (_, _, _, our), (_, channel, record, their) in zip(ours, theirs, strict=True):
            counts[channel.topic] += 1
            if channel.topic == "/imu":
                assert their.header.frame_id == f"imu_{record.log_time // S}"
                assert their.linear_acceleration.x == record.log_time // S / 2
                assert our.header.stamp.sec == their.header.stamp.sec
                assert list(our.orientation_covariance) == list(their.orientation_covariance)
            else:
                assert our.data == their.data
    assert counts == {"/imu": 10, "/chatter": 10}


def test_messages_of_overlapping_chunks_are_ordered_by_log_time(tmp_path: Path) -> None:
    path = tmp_path / "bag.mcap"
    with BagWriter(path) as writer:
        for times in ([5, 1, 30], [4, 2, 40], [3, 20, 10], [50, 60]):
            for number in times:
                writer.write("/a" if number % 20 else "/b", String(data=str(number)), number)
            writer.flush()
    with BagReader(path) as reader:
        assert [item.log_time for item in reader] == [1, 2, 3, 4, 5, 10, 20, 30, 40, 50, 60]
        assert [item.log_time for item in reader.messages("/b")] == [20, 40, 60]
        assert [item.log_time for item in reader.messages(start_ns=4, end_ns=40)] == [4, 5, 10, 20, 30]
        one, two = reader.messages(), reader.messages("/b")
        assert [next(one).log_time, next(two).log_time, next(one).log_time] == [1, 20, 2]
        assert (reader.start_ns, reader.end_ns) == (1, 60)


def test_rosbags_reads_a_written_bag_folder(tmp_path: Path) -> None:
    write_some(tmp_path / "bag", split_bytes=2000)
    store = get_typestore(Stores.ROS2_JAZZY)
    with RosbagsReader(tmp_path / "bag") as reader:
        assert reader.message_count == 20 and len(list((tmp_path / "bag").glob("*.mcap"))) > 1
        assert reader.duration == 9 * S + 2  # rosbags counts to the time after the last message
        for connection, log_time, data in reader.messages():
            decoded: Any = store.deserialize_cdr(data, connection.msgtype)
            if connection.topic == "/imu":
                assert (decoded.orientation_covariance == log_time // S).all()


@pytest.mark.parametrize("storage", [StoragePlugin.SQLITE3, StoragePlugin.MCAP])
def test_bags_of_rosbags_are_read(tmp_path: Path, storage: StoragePlugin) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    path = tmp_path / "bag"
    theirs: Any = store.types["std_msgs/msg/String"]
    with RosbagsWriter(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=store)
        for number in range(5):
            writer.write(connection, number * S, store.serialize_cdr(theirs(data=f"x{number}"), "std_msgs/msg/String"))
    for place in (path, *path.glob("*.db3"), *path.glob("*.mcap")):
        with BagReader(place) as reader:
            assert [(item.log_time, item.message.data) for item in reader] == [(n * S, f"x{n}") for n in range(5)]
            assert reader.topics["/chatter"].count == 5
            assert len(list(reader.messages(start_ns=S, end_ns=3 * S))) == 2


def test_files_of_mcap_ros2_support_are_read(tmp_path: Path) -> None:
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as stream, TheirWriter(stream) as writer:
        schema = writer.register_msgdef("geometry_msgs/msg/Point", "float64 x\nfloat64 y\nfloat64 z\n")
        for number in range(3):
            writer.write_message("/point", schema, {"x": number, "y": 0, "z": 0}, log_time=number, publish_time=number)
    with BagReader(path) as reader:
        assert [item.message.x for item in reader] == [0, 1, 2]


# ---------------------------------------------------------------------------------------------------------- decoding


@pytest.mark.parametrize("big", [False, True], ids=["little endian", "big endian"])
def test_fields_that_other_decoders_misread_are_decoded(tmp_path: Path, big: bool) -> None:
    text = "wstring text\nbuiltin_interfaces/Time before\nbuiltin_interfaces/Duration less\n"
    text += "std_msgs/Empty nothing\nint32 last\n"
    times = f"{'=' * 80}\nMSG: builtin_interfaces/{{}}\nint32 sec\nuint32 nanosec\n"
    text += times.format("Time") + times.format("Duration") + f"{'=' * 80}\nMSG: std_msgs/Empty\n"
    order = ">" if big else "<"
    body = struct.pack(f"{order}IIIiIiI", 2, 0xE4, 0x20AC, -1, 999_999_999, -3, 500_000_000)
    data = (b"\0\0\0\0" if big else b"\0\1\0\0") + body + b"\0" * 4 + struct.pack(f"{order}i", -7)
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        writer.add_topic("/mixed", BagTopic("/mixed", "local/msg/Mixed", text))
        writer.add_topic("/empty", get_message("std_msgs/msg/Empty"))
        writer.write("/mixed", data, 1)
        writer.write("/empty", b"\0\0\0\0\0" if big else b"\0\1\0\0\0", 2)
    with BagReader(path) as reader, path.open("rb") as stream:
        factory = make_reader(stream, decoder_factories=[DecoderFactory()])
        for mixed, empty in (
            [item.message for item in reader],
            [item.decoded_message for item in factory.iter_decoded_messages()],
        ):
            assert (mixed.text, mixed.before.sec, mixed.before.nanosec, mixed.last) == ("ä€", -1, 999_999_999, -7)
            assert (mixed.less.sec, mixed.less.nanosec) == (-3, 500_000_000)
            assert type(empty).__name__ == "Empty"


def test_types_of_idl_files_are_stored_as_msg_definitions_where_possible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "share" / "of_idl" / "msg"
    folder.mkdir(parents=True)
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "of_idl").touch()
    (folder / "Plain.idl").write_text(
        "module of_idl { module msg { struct Plain { double x; sequence<string<8>, 2> few; }; }; };"
    )
    (folder / "Odd.idl").write_text("module of_idl { module msg { struct Odd { long Number; }; }; };")
    (folder / "Both.msg").write_text("Plain plain\nint32 number\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    plain, odd, both = (get_message(f"of_idl/msg/{name}") for name in ("Plain", "Odd", "Both"))
    path = tmp_path / "a.mcap"
    with BagWriter(path) as writer:
        for time_ns, sample in enumerate((plain(x=1.5, few=["a"]), both(plain=plain(x=2.5)), odd(Number=3))):
            writer.write(f"/{type(sample).__name__}", sample, time_ns)
    with path.open("rb") as stream:
        theirs = make_reader(stream, decoder_factories=[TheirFactory()]).iter_decoded_messages(["/Plain", "/Both"])
        one, two = (item.decoded_message for item in theirs)
    assert (one.x, one.few, two.plain.x) == (1.5, ["a"], 2.5)
    with BagReader(path) as reader:
        assert [topic.encoding for topic in reader.topics.values()] == ["ros2msg", "ros2idl", "ros2msg"]
        assert compile_definition("of_idl/msg/Odd", reader.topics["/Odd"].definition) is odd
        assert [item.message for item in reader][2] == odd(Number=3)


def test_sequences_of_poses_are_read_as_arrays_on_request(tmp_path: Path) -> None:
    path = tmp_path / "poses.mcap"
    poses = PoseArray()
    poses.poses = [get_message("geometry_msgs/msg/Pose")() for _ in range(3)]
    poses.poses[2].position.x = 2.0
    with BagWriter(path) as writer:
        writer.write("/poses", poses, 1)
    with BagReader(path) as reader, path.open("rb") as stream:
        (one,) = reader.messages(arrays=True)
        factory = DecoderFactory(arrays=True)
        ((_, _, _, other),) = make_reader(stream, decoder_factories=[factory]).iter_decoded_messages()
        for found in (one.message, other):
            assert found.poses["position"]["x"].tolist() == [0, 0, 2] and found == poses


# ------------------------------------------------------------------------------------------------------------- others


def test_offered_qos_is_stored_and_read_back(tmp_path: Path) -> None:
    latched = QoSProfile(depth=3, durability=Durability.TRANSIENT_LOCAL)
    with BagWriter(tmp_path / "bag") as writer:
        writer.add_topic("/map", String, qos=[latched])
        writer.write("/map", String())
    for place in (tmp_path / "bag", tmp_path / "bag" / "bag_0.mcap"):
        with BagReader(place) as reader:
            assert OfferedQoS.parse(reader.topics["/map"].offered_qos) == [latched]
    with BagWriter(tmp_path / "split", split_s=1) as writer:
        writer.add_topic("/silent", String, qos=[latched])
        writer.write("/map", String(), 0)
        writer.write("/map", String(), 2 * S)
    for place in ("split_0.mcap", "split_1.mcap"):  # a topic without messages is in all of them, as rosbag2 has it
        with BagReader(tmp_path / "split" / place) as reader:
            assert {name: topic.count for name, topic in reader.topics.items()} == {"/map": 1, "/silent": 0}
    assert OfferedQoS.parse("- {history: keep_last") == OfferedQoS.parse("5") == []


def test_playback_preserves_time_intervals_scaled_by_rate(tmp_path: Path) -> None:
    path = tmp_path / "b.mcap"
    with BagWriter(path) as writer:
        for number in range(4):
            writer.write("/s", String(data=str(number)), 7 * S + number * S // 10)

    async def main() -> list[float]:
        now_s = asyncio.get_running_loop().time
        with BagReader(path) as reader:
            return [round(now_s(), 9) async for _ in reader.play(rate=2)]

    assert VirtualTimeLoop().run(main()) == [0.0, 0.05, 0.1, 0.15]


def test_writer_refuses_wrong_types_times_and_options(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "b.mcap") as writer:
        with pytest.raises(BagError, match="no type yet"):
            writer.write("/s", b"1234")
        writer.write("/s", String())
        with pytest.raises(BagError, match="/s has the type std_msgs/msg/String"):
            writer.write("/s", Imu())
        with pytest.raises(BagError, match="log time -1"):
            writer.write("/s", String(), -1)
        with pytest.raises(BagError, match="publish time 9223372036854775808"):
            writer.write("/s", String(), 1, 1 << 63)
    with pytest.raises(BagError, match="closed"):
        writer.write("/s", String())
    with pytest.raises(BagError, match="exists already"):
        BagWriter(tmp_path / "b.mcap")
    with pytest.raises(BagError, match='compression: got "gzip"'):
        BagWriter(tmp_path / "c.mcap", compression="gzip")


def test_full_disk_is_an_error_and_written_messages_remain_readable(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    writer = BagWriter(path, compression="")
    with file_size_limit(20_000_000):
        with pytest.raises(OSError, match="too large"):
            for number in range(1000):
                writer.write("/b", Bytes(data=np.zeros(100_000, np.uint8)), number)
        with pytest.raises(OSError, match="too large"):
            writer.close()
    with BagReader(path) as reader:
        assert len(list(reader)) > 100


def test_full_disk_closes_the_writer_and_keeps_the_files_before(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", compression="", split_bytes=500_000)
    for number in range(7):
        writer.write("/b", Bytes(data=np.zeros(100_000, np.uint8)), number)
    with file_size_limit(300_000):
        with pytest.raises(OSError, match="too large"):
            for number in range(7, 100):
                writer.write("/b", Bytes(data=np.zeros(100_000, np.uint8)), number)
        with pytest.raises(BagError, match="closed"):
            writer.write("/b", Bytes())
        writer.flush()
        writer.close()
    with BagReader(tmp_path / "bag") as reader:
        assert [item.log_time for item in reader] == list(range(7))  # two are in the chunk that breaks off


def test_recorder_killed_while_creating_a_file_leaves_the_other_files_readable(tmp_path: Path) -> None:
    write_some(tmp_path / "bag", split_s=3)
    (tmp_path / "bag" / "metadata.yaml").unlink()
    for beginning in (b"", b"\x89MCAP"):
        (tmp_path / "bag" / "bag_4.mcap").write_bytes(beginning)
        with BagReader(tmp_path / "bag") as reader:
            assert len(list(reader)) == 20 and not reader.has_index
    (tmp_path / "bag" / "bag_4.mcap").write_bytes(b"MCAP")
    require_error(tmp_path / "bag", "does not begin with the magic bytes of MCAP")


def test_renamed_file_is_suggested_in_the_error(tmp_path: Path) -> None:
    write_some(tmp_path / "bag")
    (tmp_path / "bag" / "bag_0.mcap").rename(tmp_path / "bag" / "drive.mcap")
    require_error(tmp_path / "bag", r"refers to bag_0\.mcap, which does not exist; drive\.mcap exists and can be read")
    with BagReader(tmp_path / "bag" / "drive.mcap") as reader:
        assert len(list(reader)) == 20


def test_paths_that_are_not_bags_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "x.txt").write_text("x")
    for path, text in (
        (tmp_path / "empty", "neither metadata.yaml nor bag files"),
        (tmp_path / "x.txt", "expected .mcap, .db3"),
        (tmp_path / "none.db3", "file does not exist"),
    ):
        require_error(path, text)
    with pytest.raises(OSError, match=r"none\.mcap"):
        BagReader(tmp_path / "none.mcap")


def test_messages_read_with_a_class_are_its_instances_or_the_mismatch_is_an_error(tmp_path: Path) -> None:
    path = write_strings(tmp_path / "a.mcap", ["x", "y"])
    same = compile_definition("std_msgs/msg/String", "string data")
    other = compile_definition("std_msgs/msg/String", "string data\nint32 number")
    with BagReader(path) as reader:
        for cls in (String, same):
            items = list(reader.messages("/s", cls))
            assert [(type(item.message), item.message.data) for item in items] == [(cls, "x"), (cls, "y")]
        with pytest.raises(BagError, match="/s has messages of std_msgs/msg/String; expected std_msgs/msg/Bool"):
            reader.messages("/s", Bool)
        with pytest.raises(BagError, match="/s was recorded with another definition of std_msgs/msg/String"):
            reader.messages("/s", other)
        for arguments, options in [((None, String), {}), (("/s", String), {"raw": True}), (("/s", str), {})]:
            with pytest.raises(TypeError, match="message_class"):
                reader.messages(*arguments, **options)  # type: ignore[call-overload]
        assert BagMessage[String](*items[0]) == items[0]


def test_repr_of_a_reader_has_path_and_counts(tmp_path: Path) -> None:
    path = write_strings(tmp_path / "a.mcap", ["x", "y"])
    with BagReader(path) as reader:
        assert repr(reader) == f"<BagReader {str(path)!r}: 2 messages of 1 topic>"
