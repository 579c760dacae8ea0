"""Probes of `transport/cyclone/private_layout.py` in the loaded library, and ownership of samples."""

from __future__ import annotations

import ctypes as ct
import gc
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String
from std_srvs.srv import SetBool
from support import raw_endpoints
from support.inner_state import participant_of

from rosidl_py_gen.runtime.transport.api import EndpointSpec, TopicKey, TransportError
from rosidl_py_gen.runtime.transport.cyclone import library, private_layout
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.qos import DEFAULT

if TYPE_CHECKING:
    from collections.abc import Iterator

    from support.worlds import World

pytestmark = pytest.mark.dds  # all use the loaded library

API, SUPPORT = cyclone.API, cyclone.FAST_DDS_SUPPORT
TEXT = "std_msgs::msg::dds_::String_"
HEADER = b"\0\1\0\0"


@pytest.fixture
def participant(dds: World) -> Any:
    node = dds.node("ours")
    node.create_publisher(String, "topic")
    node.create_service(SetBool, "set_bool")
    return participant_of(node)


@pytest.fixture
def pinned(participant: Any) -> Iterator[Any]:
    """Function that locks entities until the end of the test."""
    with ExitStack() as stack:
        yield lambda entity: stack.enter_context(API.locked_entity(entity))


# -------------------------------------------------------------------------------------------------------------- probes


def test_reading_unmapped_memory_returns_no_bytes() -> None:
    known = ct.create_string_buffer(b"0123456789" * 1000)
    with private_layout.SafeMemoryReader() as peek:
        assert peek(ct.addressof(known), 10_000) == known.raw[:-1]
        for address in (0, 8, 2**47, 2**63, 2**64 - 4096):
            assert peek(address, 100) == b"" and peek.word(address) == 0


def test_sertype_of_a_topic_is_probed_by_name_and_version(participant: Any, pinned: Any) -> None:
    topic = pinned(participant.domain.types.create_topic(participant.entity, "rt/topic", TEXT))
    address = participant.domain.types[TEXT].address
    assert private_layout.probe_sertype(topic, TEXT.encode(), API.sertype_version) == address
    assert private_layout.probe_sertype(topic, TEXT.encode() + b"x", API.sertype_version) is None
    assert private_layout.probe_sertype(topic, TEXT.encode(), API.sertype_version + 1) is None


def test_other_types_of_the_domain_are_found_from_a_known_type(participant: Any) -> None:
    address = participant.domain.types[TEXT].address
    for name in (b"DDS::Builtin::TypeLookup_Reply", b"DDS::Builtin::TypeLookup_Request"):
        assert private_layout.find_type_of_domain(address, name, API.sertype_version)
    assert private_layout.find_type_of_domain(address, b"DDS::Builtin::Nothing", API.sertype_version) is None


def test_reader_offsets_are_probed_by_guid(participant: Any, pinned: Any) -> None:
    entity = participant.discovery.entities[0]
    guid = API.guid_of(entity)
    assert private_layout.probe_reader_offsets(pinned(entity), guid) == SUPPORT.reader_offsets is not None
    unknown = bytes(byte ^ 255 for byte in guid)
    assert private_layout.probe_reader_offsets(pinned(entity), unknown) is None
    wrong = private_layout.ReaderOffsets(entity=8, flags=8)
    assert "a reader" in (private_layout.set_requests_history(pinned(entity), wrong, guid, True) or "")


def test_reader_flags_that_contradict_the_qos_are_not_modified(participant: Any, pinned: Any, dds: World) -> None:
    reader: Any = raw_endpoints.reader(dds.node("other"), "rt/topic", TEXT)
    offsets = SUPPORT.reader_offsets
    assert offsets is not None
    unexpected = private_layout.set_requests_history(pinned(reader.entity), offsets, reader.guid, False)
    assert unexpected is not None and unexpected.startswith("the flags of a reader")


def test_sample_is_shortened_only_at_its_size_offset(participant: Any) -> None:
    offset = private_layout.probe_size_offset(API, *participant.domain.types[TEXT])
    assert offset is not None
    sample = new(participant, HEADER + b"12345678")
    for wrong in (offset - 4, offset + 4):
        assert not private_layout.hide_sample_tail(API, sample, wrong, 4) and API.serdata_size(sample) == 12
    assert private_layout.hide_sample_tail(API, sample, offset, 4) and API.serdata_size(sample) == 8
    number = ct.c_uint32(4)  # not the size of the sample
    assert not private_layout.hide_sample_tail(API, sample, ct.addressof(number) - sample, 2) and number.value == 4
    API.serdata_unref(sample)


def test_size_offset_is_unknown_if_samples_lack_functions_of_their_type(
    participant: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, payload_offset = participant.domain.types[TEXT]
    original = private_layout.vtable_address
    monkeypatch.setattr(private_layout, "vtable_address", lambda at, which: original(at, which) + (at == address))
    assert private_layout.probe_size_offset(API, address, payload_offset) is None


def test_topic_is_refused_if_its_sertype_is_not_found(participant: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(vars(API), "get_entity_sertype", None)
    monkeypatch.setattr(private_layout, "probe_sertype", lambda *_: None)
    with pytest.raises(TransportError, match="the type was not found in the topic"):
        participant.domain.types.create_topic(participant.entity, "rt/new", "pkg::msg::dds_::New_")


# ------------------------------------------------------------------------------------------------------------- samples


def add_reference(sample: int) -> None:
    API.library.ddsi_serdata_ref(ct.c_void_p(sample))


def reference_count(sample: int) -> int:
    blank = (ct.c_uint32 * 64)()
    add_reference(ct.addressof(blank))
    (offset,) = (4 * index for index, number in enumerate(blank) if number)
    return ct.c_uint32.from_address(sample + offset).value


def new(participant: Any, data: bytes) -> int:
    return private_layout.new_sample(API, participant.domain.types[TEXT].address, data)


@pytest.mark.parametrize("data", [b"", HEADER[:3], HEADER, b"\0\3\0\0....", b"\xff\xff\0\0...."])
def test_invalid_serialized_messages_create_no_sample(participant: Any, data: bytes) -> None:
    assert new(participant, data) == 0
    writer = participant.create_writer(EndpointSpec(TopicKey("topic", "/topic"), TEXT, DEFAULT))
    if len(data) % 4 == 0:
        with pytest.raises(TransportError, match="not a serialized message"):
            writer.write(data)


def test_write_consumes_the_sample_reference_unless_it_fails_before_the_writer(participant: Any) -> None:
    writer = participant.create_writer(EndpointSpec(TopicKey("topic", "/topic"), TEXT, DEFAULT))
    for entity, code, left in ((writer.entity, 0, 1), (participant.entity, -12, 2), (0x1234567, -3, 2)):
        sample = new(participant, HEADER + b"12345678")
        add_reference(sample)
        assert API.writecdr(entity, sample) == code
        assert reference_count(sample) == left and (code in library.SAMPLE_NOT_CONSUMED) == (left == 2)
        for _ in range(left):
            API.serdata_unref(sample)


def test_local_readers_share_the_memory_of_the_written_sample(dds: World) -> None:
    node = dds.node("ours")
    publisher = node.create_publisher(String, "large")
    readers = [raw_endpoints.reader(node, "rt/large", TEXT) for _ in range(2)]
    publisher.publish(String(data="x" * 1_000_000))
    views: list[Any] = [reader.queue.items.popleft()[0] for reader in readers]
    assert all(isinstance(view, memoryview) and view.readonly for view in views)
    assert len({ct.addressof(view.obj) for view in views}) == 1


def test_sample_view_stays_valid_after_reader_and_domain_closed(dds: World) -> None:
    context = dds.context()
    node = dds.node("ours", context=context)
    publisher, reader = node.create_publisher(String, "large"), raw_endpoints.reader(node, "rt/large", TEXT)
    publisher.publish(String(data="y" * 3_000_000))
    view = reader.queue.items.popleft()[0]
    context.close()
    gc.collect()
    assert String.decode(view).data == "y" * 3_000_000


def test_sample_with_identity_is_not_referenced_by_us_after_the_write(
    participant: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = "std_srvs::srv::dds_::SetBool_Request_"
    writer = participant.create_writer(EndpointSpec(TopicKey("topic", "/requests"), kind, DEFAULT))
    made: list[int] = []

    def new_sample(*arguments: Any) -> int:
        made.append(make(*arguments))
        add_reference(made[-1])
        return made[-1]

    make = private_layout.new_sample
    monkeypatch.setattr(private_layout, "new_sample", new_sample)
    assert writer.write(HEADER + b"1234", (writer.guid, 1))
    assert [reference_count(sample) for sample in made] == [1]
    API.serdata_unref(made[0])
