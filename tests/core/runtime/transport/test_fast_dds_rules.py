"""Rules of `transport/cyclone/fast_dds_interop/`: sample identities, hooks of domains, and peers of participants.

Peers are our own, changed to speak as Fast DDS peers; real ones are in `tests/peers/interop` and `interop_rclpy`.
HOOK_ROUNDS=1000 starts, stops and forks a thousand processes.
"""

from __future__ import annotations

import asyncio
import ctypes as ct
import os
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import Int32, String
from std_srvs.srv import SetBool
from support import raw_endpoints
from support.fast_dds import new_domain, new_peers
from support.inner_state import participant_of, transport_end_of
from support.processes import python_process
from support.waiting import wait_until

from rosidl_py_gen.msgs.rcl_interfaces.srv import GetParameterTypes
from rosidl_py_gen.runtime import IncompatibleServiceError
from rosidl_py_gen.runtime.transport.api import EntityLost, ParticipantDiscovered
from rosidl_py_gen.runtime.transport.cyclone import participant as cyclone
from rosidl_py_gen.runtime.transport.cyclone import private_layout
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsPeers, FastDdsSupport
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop.sample_identity import INLINE_QOS_BYTES
from rosidl_py_gen.runtime.transport.cyclone.private_layout import DATA, DATA_FRAG, INFO_DST, INFO_SRC, INLINE_QOS_FLAG
from rosidl_py_gen.runtime.transport.dds import services
from rosidl_py_gen.runtime.transport.qos import SERVICES_DEFAULT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from support.worlds import World

    from rosidl_py_gen.runtime import Node

pytestmark = pytest.mark.dds  # all use the loaded library

SUPPORT = cyclone.FAST_DDS_SUPPORT
FAST_GUID = b"\x01\x0f" + bytes(10) + b"\0\0\1\xc1"
CYCLONE_GUID = b"\x01\x10" + FAST_GUID[2:]
STRING = "std_msgs::msg::dds_::String_"
REQUEST = "std_srvs::srv::dds_::SetBool_Request_"
TYPES_REQUEST = "rcl_interfaces::srv::dds_::GetParameterTypes_Request_"
AS_FAST_DDS = """
import asyncio, os, sys
from rosidl_py_gen.runtime import Node
from rosidl_py_gen.runtime.transport.cyclone.fast_dds_interop import FastDdsPeers
from rosidl_py_gen.runtime.transport.dds import services
from rosidl_py_gen.msgs.rcl_interfaces.srv import GetParameterTypes as Types

# Every participant is considered one on Fast DDS, so hooks are active, and servers need the identity.
FastDdsPeers.uses_sample_identity = lambda self, guid: True
services.ClientCorrelation.all_answered = lambda self: False

def answer(request):
    return Types.Response(types=[len(name) for name in request.names])
"""
SERVER = f"""{AS_FAST_DDS}
async def main():
    async with Node("server") as node:
        node.create_service(Types, "types", answer)
        await asyncio.Event().wait()

asyncio.run(main())
"""
CALLER = f"""{AS_FAST_DDS}
async def main():
    async with Node("caller") as node:
        types = node.create_client(Types, "types")
        while True:
            await asyncio.gather(*(types.call(Types.Request(names=["x"] * count), 20) for count in (1, 10, 20_000)))
            print("x", flush=True)

asyncio.run(main())
"""
SHORT_LIFE = f"""{AS_FAST_DDS}
from rosidl_py_gen.runtime.node.context import close_all

async def main():
    async with Node("mayfly") as node:
        node.create_service(Types, "own", answer)
        own = node.create_client(Types, "own")
        assert list((await own.call(Types.Request(names=["abc"]), 10)).types) == [3]

def child():  # recreates everything
    pid = os.fork()
    if pid == 0:
        asyncio.run(main())
        close_all()
        os._exit(0)
    assert os.waitpid(pid, 0)[1] == 0

child()
asyncio.run(main())
close_all()
child()
asyncio.run(main())
if len(sys.argv) > 1:  # leave without closing anything
    node = Node("left")
    node.create_service(Types, "left", answer)
"""


@pytest.fixture
def as_fast_dds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make participants consider every participant one on Fast DDS, which activates the receive hook."""
    monkeypatch.setattr(FastDdsPeers, "uses_sample_identity", lambda self, guid: True)
    monkeypatch.setattr(services.ClientCorrelation, "all_answered", lambda self: False)


def vtable_of(node: Node, dds_type: str) -> int:
    """Return the address of the vtable of samples."""
    participant = participant_of(node)
    return private_layout.vtable_address(participant.domain.types[dds_type].address, private_layout.SAMPLE_FUNCTIONS)


def receive_function(node: Node) -> Any:
    """Return the function that creates samples of received requests of `SetBool`."""
    return (ct.c_void_p * 17).from_address(vtable_of(node, REQUEST))[2]


def with_service(node: Node, on_request: Callable[[bool], object] = bool) -> Node:
    """Add a service `set_bool` with a long response to True."""

    def answer(request: SetBool.Request) -> SetBool.Response:
        on_request(request.data)
        return SetBool.Response(success=request.data, message="m" * 999_999 * request.data)

    node.create_service(SetBool, "set_bool", answer)
    return node


def server_without_peers(dds: World) -> tuple[Node, Any, Any]:
    """Return a node with a service, its participant, and the plain function for received requests."""
    node = with_service(dds.node("ours"))
    participant = participant_of(node)
    participant.report_discovery()
    return node, participant, receive_function(node)


# -------------------------------------------------------------------------------------------------------------- hooks


def test_vtables_of_topic_types_are_not_modified(dds: World) -> None:
    node = with_service(dds.node("ours"))
    node.create_publisher(String, "topic")
    node.create_publisher(Int32, "number")
    names = ("std_msgs::msg::dds_::String_", "std_msgs::msg::dds_::Int32_")
    services = ("std_srvs::srv::dds_::SetBool_Request_", "std_srvs::srv::dds_::SetBool_Response_")
    addresses = [vtable_of(node, name) for name in (*names, *services)]
    assert addresses[0] == addresses[1]
    assert len(set(addresses)) == 3


def test_receive_hook_is_active_only_while_fast_dds_peers_may_exist(dds: World) -> None:
    node, participant, plain = server_without_peers(dds)
    peers: FastDdsPeers = participant.fast_dds
    for guid, is_hooked in ((CYCLONE_GUID, False), (FAST_GUID, True)):
        peers.on_participants_pending()
        assert receive_function(node) != plain
        peers.begin_read()
        peers.end_read([ParticipantDiscovered(guid, None)])
        assert (receive_function(node) != plain) is is_hooked
    peers.end_read([EntityLost(FAST_GUID)])
    assert receive_function(node) == plain
    peers.begin_read()
    peers.on_participants_pending()  # while discovery is read
    peers.end_read([])
    assert receive_function(node) != plain
    participant.report_discovery()
    assert receive_function(node) == plain


def test_peers_of_another_domain_and_of_closed_participants_activate_no_receive_hook(dds: World) -> None:
    node, participant, plain = server_without_peers(dds)
    other = new_domain()
    peers = [new_peers(domain) for domain in (other, participant.domain.fast_dds)]
    for one in peers:
        one.end_read([ParticipantDiscovered(FAST_GUID, None)])
    peers[0].on_participants_pending()
    assert receive_function(node) == plain
    peers[1].on_participants_pending()
    assert receive_function(node) != plain
    for one in peers:
        one.close()
    assert receive_function(node) == plain and not other.members and len(participant.domain.fast_dds.members) == 1


def test_closed_domain_retains_no_peers_and_returns_its_hooks(dds: World) -> None:
    context = dds.context()
    participant = participant_of(with_service(dds.node("ours", context=context)))
    peers, domain = participant.fast_dds, participant.domain
    hooks = domain.fast_dds.identities_of(domain.types[REQUEST].address)
    peers.end_read([ParticipantDiscovered(FAST_GUID, None)])
    assert hooks.is_lent and peers.may_exist() and domain.fast_dds.members == {peers}
    context.close()
    assert not hooks.is_lent and not peers.may_exist() and not domain.fast_dds.members
    reopened = participant_of(with_service(dds.node("again"))).domain
    assert reopened is not domain and reopened.fast_dds.identities_of(reopened.types[REQUEST].address) is hooks


def test_receive_hooks_belong_to_one_domain_and_are_reused_after_release(dds: World) -> None:
    _, participant, _ = server_without_peers(dds)
    support, types = FastDdsSupport(cyclone.API), participant.domain.types
    first = support.lend_hooks(types[REQUEST], is_reply=False)
    second = support.lend_hooks(types[REQUEST], is_reply=False)
    assert first is not None and second is not None and first is not second
    assert support.lend_hooks(types[REQUEST], is_reply=True) not in (first, second)
    support.release_hooks(first)
    assert support.lend_hooks(types[REQUEST], is_reply=False) is first


@pytest.mark.slow
def test_receive_hook_is_activated_by_new_participant_without_a_loop(dds: World) -> None:
    node, participant, plain = server_without_peers(dds)
    with python_process(SERVER):  # no loop runs here
        wait_until(lambda: receive_function(node) != plain)
        participant.report_discovery()  # it is on Cyclone
        assert receive_function(node) == plain


# -------------------------------------------------------------------------------------------------- sample identities


async def test_calls_with_sample_identity_work_inside_one_process(dds: World, as_fast_dds: None) -> None:
    requests: list[bool] = []
    client = with_service(dds.node("ours"), requests.append).create_client(SetBool, "set_bool")
    for number in range(20):
        response = await client.call(SetBool.Request(data=bool(number % 2)), timeout_s=10)
        assert (response.success, len(response.message)) == (bool(number % 2), 999_999 * (number % 2))
    assert requests == [False, True] * 10  # none was repeated


@pytest.mark.slow
@pytest.mark.parametrize("lossiness", [0, 100], ids=["all packets", "one of ten lost"])
async def test_calls_with_sample_identity_work_between_processes_with_packet_loss(
    dds: World, as_fast_dds: None, lossiness: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    test = f"<Internal><Test><XmitLossiness>{lossiness}</XmitLossiness></Test></Internal>"
    # A participant whose first announcements are lost is discovered by the next ones, by default after 3 s.
    discovery = "<Discovery><SPDPInterval>500ms</SPDPInterval></Discovery>"
    monkeypatch.setenv("CYCLONEDDS_URI", f"<CycloneDDS><Domain>{discovery}{test}</Domain></CycloneDDS>")
    with python_process(SERVER):
        types = dds.node("ours").create_client(GetParameterTypes, "types")
        for count in (0, 1, 7, 500, 20_000, 200_000):
            request = GetParameterTypes.Request(names=["x" * (index % 5) for index in range(count)])
            response = await types.call(request, timeout_s=25)
            assert bytes(response.types) == bytes(index % 5 for index in range(count))
    assert SUPPORT.refusal is None


@pytest.mark.slow
async def test_endpoints_can_be_created_and_closed_during_calls_of_other_nodes(dds: World, as_fast_dds: None) -> None:
    server = dds.node("server")
    server.create_service(
        GetParameterTypes,
        "types",
        lambda request: GetParameterTypes.Response(types=bytes(len(name) for name in request.names)),
    )
    is_over = threading.Event()

    def create_and_close(number: int) -> None:
        node = dds.node(f"busy_{number}")
        while not is_over.is_set():
            service = node.create_service(f"std_srvs/srv/{('Empty', 'Trigger', 'SetBool')[number]}", "own")
            client = node.create_client(GetParameterTypes, "types")
            publisher = node.create_publisher(f"std_msgs/msg/{('Bool', 'Char', 'Byte')[number]}", "topic")
            for endpoint in (service, client, publisher):
                endpoint.close()

    threads = [threading.Thread(target=create_and_close, args=(number,)) for number in range(3)]
    with python_process(CALLER) as first, python_process(CALLER) as second:
        for thread in threads:
            thread.start()
        for _ in range(30):
            for caller in (first, second):
                assert caller.stdout is not None
                assert await asyncio.wait_for(asyncio.to_thread(caller.stdout.readline), 20) == "x\n"
        is_over.set()
        for thread in threads:
            await asyncio.to_thread(thread.join, 20)
            assert not thread.is_alive()


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_processes_with_hooks_start_stop_and_fork() -> None:
    for number in range(int(os.environ.get("HOOK_ROUNDS", "4"))):
        with python_process(SHORT_LIFE, *(["leave"] if number % 2 else [])) as process:
            assert process.wait(60) == 0


# ----------------------------------------------------------------------------------------------------- unknown layouts


@pytest.mark.parametrize("probe", ["probe_vtable_slots", "probe_size_offset"])
def test_library_of_unknown_layout_is_refused_and_not_modified(
    dds: World, probe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = with_service(dds.node("ours"))
    participant = participant_of(node)
    before = vtable_of(node, REQUEST)
    monkeypatch.setattr(private_layout, probe, lambda *_: None)
    fast_dds = FastDdsSupport(cyclone.API)
    new_domain(fast_dds).prepare(participant.domain.types[REQUEST], REQUEST)
    assert vtable_of(node, REQUEST) == before
    assert fast_dds.refusal is not None and "in this library" in fast_dds.refusal
    assert fast_dds.capabilities()["services of nodes on Fast DDS"] == fast_dds.refusal


def test_samples_without_constant_payload_offset_are_copied(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    participant = participant_of(with_service(dds.node("ours")))
    fast_dds = FastDdsSupport(cyclone.API)
    without_offset = participant.domain.types[REQUEST]._replace(payload_offset=None)
    new_domain(fast_dds).prepare(without_offset, REQUEST)
    assert fast_dds.refusal == "payloads do not have a constant offset in samples"
    node = dds.node("other")
    monkeypatch.setattr(private_layout, "probe_payload_offset", lambda *_: None)
    publisher, reader = node.create_publisher(String, "topic"), raw_endpoints.reader(node, "rt/topic", STRING)
    for text in ("small", "x" * 100_000):
        publisher.publish(String(data=text))
        assert String.decode(reader.queue.items.popleft()[0]).data == text


def test_fast_dds_services_are_refused_in_a_32_bit_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(private_layout, "WORD", 4)
    assert FastDdsSupport(cyclone.API).refusal == "not tested on Linux with 32 bits, little-endian"


def test_refusal_is_warned_about_once_when_a_fast_dds_peer_appears() -> None:
    support = FastDdsSupport(cyclone.API)
    peers = new_peers(new_domain(support))
    support.refusal = "a test"
    peers.end_read([ParticipantDiscovered(CYCLONE_GUID, None)])
    assert peers.new_warnings() == []
    peers.end_read([ParticipantDiscovered(FAST_GUID, None)])
    assert peers.new_warnings() == ["services of Fast DDS nodes cannot be used here, topics can: a test"]
    assert peers.new_warnings() == []
    support.lookup_refusal = "another"
    assert [warning.endswith("may end this process: another") for warning in peers.new_warnings()] == [True]


async def test_unknown_build_refuses_fast_dds_services_but_topics_work(
    dds: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SUPPORT, "refusal", "this build is not known")
    alice, bob = dds.pair()
    publisher = alice.create_publisher(String, "topic")
    subscription = bob.create_subscription(String, "topic")
    assert await publisher.wait_for_subscribers(timeout_s=10)
    publisher.publish(String(data="through"))
    assert (await subscription.receive(timeout_s=20)).data == "through"
    client = bob.create_client(SetBool, "set_bool")
    for number, (topic, kind) in enumerate((("rq/set_boolRequest", "Request"), ("rr/set_boolReply", "Response")), 1):
        last = b"\x03" if kind == "Response" else b"\x04"
        guid, type_name = FAST_GUID[:12] + bytes((0, 0, number)) + last, f"std_srvs::srv::dds_::SetBool_{kind}_"
        found = raw_endpoints.found(guid, FAST_GUID, topic, type_name, SERVICES_DEFAULT)
        participant_of(bob).discovery.sink([found])
    with pytest.raises(IncompatibleServiceError, match="RMW_IMPLEMENTATION=rmw_cyclonedds_cpp"):
        await client.wait_for_service(timeout_s=10)
    with pytest.raises(IncompatibleServiceError, match=r"Topics work with it.*this build is not known"):
        await client.call(SetBool.Request(), timeout_s=10)


class Packet:
    """Packet under construction, in the layout of Cyclone DDS."""

    def __init__(self, submessage: bytes, *, source: int = INFO_SRC) -> None:
        self.data = ct.create_string_buffer(
            bytes((source,)).ljust(24, b"\0") + bytes((INFO_DST,)).ljust(16, b"\0") + submessage + bytes(80)
        )
        self.words = (ct.c_uint64 * 64)()  # all words that the hook reads
        self.words[1], self.words[2] = len(submessage) + 80, len(submessage)  # capacity and size
        self.words[19] = ct.addressof(self.data)
        self.iov = ct.addressof(self.words) + 40


WRITER = b"\0\0\x14\x03"
INLINE_QOS = b"q" * INLINE_QOS_BYTES


def packet(kind: int = DATA, *, writer: bytes = WRITER, number: int = 0, source: int = INFO_SRC) -> Packet:
    submessage = bytes((kind, 1)) + bytes(10) + writer + bytes(4) + number.to_bytes(4, "little")
    return Packet(submessage + bytes(12) if kind == DATA_FRAG else bytes(12) + submessage, source=source)


@pytest.mark.parametrize(
    ("made", "is_known"),
    [
        (packet(), True),
        (packet(DATA_FRAG), True),
        (packet(0x17), False),
        (packet(writer=b"\0\0\x15\x03"), False),
        (packet(source=0), False),
    ],
    ids=["DATA", "DATA_FRAG", "another submessage", "of another writer", "another head"],
)
def test_inline_qos_is_appended_only_to_packets_of_known_layout(made: Packet, is_known: bool) -> None:
    fast_dds = FastDdsSupport(cyclone.API)
    before, size = made.data.raw, made.words[2]
    fast_dds.append_inline_qos(made.iov, WRITER, INLINE_QOS)
    changed = [index for index, (old, new) in enumerate(zip(before, made.data.raw, strict=True)) if old != new]
    assert len(changed) == (is_known and 1 + len(INLINE_QOS))
    assert made.data.raw[40 + size : 40 + made.words[2]] == (INLINE_QOS if is_known else b"")
    assert (fast_dds.refusal is None) is is_known


def test_stale_packet_addresses_are_not_mistaken_for_the_packet() -> None:
    # Cyclone does not clear this memory: it may contain the address twice, or the address of an older packet.
    fast_dds, first, older = FastDdsSupport(cyclone.API), packet(number=7), packet(number=6)
    first.words[18] = first.words[19]
    first.words[16] = first.words[30] = older.words[19]
    before = older.data.raw
    fast_dds.append_inline_qos(first.iov, WRITER, INLINE_QOS)
    assert first.data.raw[53] == 1 | INLINE_QOS_FLAG and older.data.raw == before
    other = packet(number=8)
    other.words[18] = ct.addressof(ct.create_string_buffer(256))
    size = other.words[2]
    for _ in range(2):
        other.words[2] = size
        fast_dds.append_inline_qos(other.iov, WRITER, INLINE_QOS)
    assert other.data.raw[53] == 1 | INLINE_QOS_FLAG
    assert fast_dds.refusal is None
    moved = packet(number=9)  # the place of the address is known now
    moved.words[18], moved.words[19] = moved.words[19], 0
    fast_dds.append_inline_qos(moved.iov, WRITER, INLINE_QOS)
    assert "a packet to send" in fast_dds.refusal


@pytest.mark.parametrize(("word", "value"), [(1, 1), (3, 1), (4, 1)], ids=["room", "other parameters", "has a message"])
def test_complete_or_foreign_packets_are_not_modified_and_cause_no_refusal(word: int, value: int) -> None:
    fast_dds = FastDdsSupport(cyclone.API)
    made = packet()
    made.words[word] = value
    before = made.data.raw
    fast_dds.append_inline_qos(made.iov, WRITER, INLINE_QOS)
    assert made.data.raw == before and fast_dds.refusal is None


@contextmanager
def interrupted(hooks: Any) -> Iterator[list[Any]]:
    """Expect a KeyboardInterrupt by a SIGINT inside the send hook; yield the calls of the hook."""
    calls: list[Any] = []

    def to_ser_ref(*arguments: int) -> Any:
        signal.raise_signal(signal.SIGINT)
        calls.append(arguments)
        return original(*arguments)

    original = hooks.plain_to_ser_ref
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hooks, "plain_to_ser_ref", to_ser_ref)
        try:
            with pytest.raises(KeyboardInterrupt):
                yield calls
        finally:
            signal.signal(signal.SIGINT, before)


@pytest.mark.slow
async def test_ctrl_c_is_raised_after_the_send_hook_returned_to_cyclone(dds: World, as_fast_dds: None) -> None:
    client = with_service(dds.node("ours")).create_client(SetBool, "set_bool")
    await client.call(SetBool.Request(), timeout_s=10)
    with python_process(SERVER):
        types = dds.node("other").create_client(GetParameterTypes, "types")
        assert await types.wait_for_service(timeout_s=20)
        domain = participant_of(types).domain
        hooks = domain.fast_dds.identities_of(domain.types[TYPES_REQUEST].address)
        with interrupted(hooks) as calls:
            types.send_request(GetParameterTypes.Request(names=["x"]))
        assert len(calls) == 1
        assert (await types.call(GetParameterTypes.Request(names=["abc"]), timeout_s=10)).types.tolist() == [3]
        writer: Any = transport_end_of(types)._writer
        with interrupted(hooks) as calls:  # the hook is called for a sample without identity, too
            writer.write(services.add_request_header(GetParameterTypes.Request(names=["y"]).encode(), 1, 1))
        assert len(calls) == 1


async def test_calls_are_refused_after_unexpected_data_disabled_the_hooks(
    dds: World, as_fast_dds: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = with_service(dds.node("ours")).create_client(SetBool, "set_bool")
    await client.call(SetBool.Request(), timeout_s=10)
    monkeypatch.setattr(SUPPORT, "refusal", None)  # restored at the end
    SUPPORT.disable("a test")
    with pytest.raises(IncompatibleServiceError, match="unexpected data in Cyclone DDS: a test"):
        await client.call(SetBool.Request(), timeout_s=10)
