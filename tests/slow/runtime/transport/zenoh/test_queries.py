"""Requests and responses as queries of Zenoh, also with peers that misbehave."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

import pytest
from example_interfaces.action import Fibonacci
from example_interfaces.srv import AddTwoInts
from std_msgs.msg import String
from support.inner_state import participant_of, reader_of, servers_of, transport_end_of
from support.local_network import zenoh_environment
from support.waiting import until
from support.worlds import World

from rosidl_py_gen import DecodeError, type_hash
from rosidl_py_gen.runtime import CallTimeoutError, ServerLostError
from rosidl_py_gen.runtime.transport.zenoh import services
from rosidl_py_gen.runtime.transport.zenoh.wire_formats import pack_attachment

GID = bytes(range(16))


class Pair:
    """Server that the test answers for, and its client."""

    def __init__(self, world: World) -> None:
        self.node = world.node("server")
        self.server = self.node.create_service(AddTwoInts, "add")
        self.client = world.node("caller").create_client(AddTwoInts, "add")
        self.reader: Any = transport_end_of(self.server)
        self.replies: Any = transport_end_of(self.client)
        self.session: Any = participant_of(self.node).session
        self.key = (
            f"{self.node.context.domain_id}/add/example_interfaces::srv::dds_::AddTwoInts_/{type_hash(AddTwoInts)}"
        )

    def call(self, timeout_s: float | None = 20) -> asyncio.Future[Any]:
        return asyncio.ensure_future(self.client.call(AddTwoInts.Request(a=1, b=2), timeout_s=timeout_s))

    async def first_request(self) -> tuple[tuple[bytes, int], Any]:
        await until(lambda: self.reader.queries)
        identity = next(iter(self.reader.queries))
        return identity, self.reader.pop_query(identity).query


@pytest.fixture
def pair(zenoh: World) -> Pair:
    return Pair(zenoh)


async def test_timed_out_and_cancelled_calls_leave_no_query(pair: Pair) -> None:
    assert await pair.client.wait_for_service(20)
    with pytest.raises(CallTimeoutError):
        await pair.call(0.2)
    assert not pair.replies.in_flight
    for number in range(200):
        calling = pair.call()
        await asyncio.sleep(0.0001 * (number % 10))  # at every stage of a call
        calling.cancel()
    await until(lambda: not pair.replies.in_flight)
    assert pair.client.in_flight_count == 0


async def test_answered_calls_leave_no_query(zenoh: World) -> None:
    zenoh.node("server").create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=3))
    client = zenoh.node("caller").create_client(AddTwoInts, "add")
    calls = (client.call(AddTwoInts.Request(), timeout_s=20) for _ in range(200))
    assert {response.sum for response in await asyncio.gather(*calls)} == {3}
    replies: Any = transport_end_of(client)
    await until(lambda: not replies.in_flight)


async def test_queries_answered_by_one_of_two_servers_are_bounded(pair: Pair, zenoh: World) -> None:
    zenoh.node("second").create_service(AddTwoInts, "add", lambda request: AddTwoInts.Response(sum=3))
    await until(lambda: len(pair.replies.connected()) == 2)
    for _ in range(30):
        assert (await pair.call()).sum == 3
    assert len(pair.replies.in_flight) == services.MAX_ANSWERED_QUERIES


async def test_closing_client_cancels_its_calls_in_flight(pair: Pair) -> None:
    calls = [pair.call() for _ in range(20)]
    await until(lambda: len(pair.replies.in_flight) == 20)
    pair.client.close()
    assert not pair.replies.in_flight
    for result in await asyncio.gather(*calls, return_exceptions=True):
        assert "was closed during the call" in str(result)


async def test_error_reply_of_zenoh_raises_server_lost_error(pair: Pair) -> None:
    calling = pair.call()
    _, query = await pair.first_request()
    query.reply_err(b"no \x1b[31mnumbers" + 1000 * b"!")
    query.drop()
    with pytest.raises(
        ServerLostError, match=r"server of /add answered with an error: no .\[31mnumbers!+\.\.\.\Z"
    ) as caught:
        await calling
    assert len(str(caught.value)) < 400


async def test_zenoh_query_timeout_applies_only_to_calls_without_timeout(
    zenoh: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    override = f"{zenoh_environment()['ZENOH_CONFIG_OVERRIDE']};queries_default_timeout=200"
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", override)
    pair = Pair(zenoh)
    endless, limited = pair.call(None), pair.call(20)
    requests = [await anext(pair.server) for _ in range(2)]
    with pytest.raises(ServerLostError, match="the server of /add did not answer in time"):
        await endless
    requests[1].respond(AddTwoInts.Response(sum=3))
    assert (await limited).sum == 3

    async def execute(goal: Any) -> Any:
        await asyncio.sleep(0.5)  # longer than the timeout of Zenoh
        return Fibonacci.Result(sequence=[1])

    pair.node.create_action_server(Fibonacci, "fibonacci", execute)
    client = zenoh.node("sender").create_action_client(Fibonacci, "fibonacci")
    goal = await client.send_goal(Fibonacci.Goal(order=1), timeout_s=20)
    assert list((await goal.result())[1].sequence) == [1]


async def test_response_is_accepted_after_its_server_token_disappeared(pair: Pair) -> None:
    # Zenoh sends tokens before replies, even if the reply was first.
    calling = pair.call()
    await until(lambda: pair.reader.queries)
    participant = participant_of(pair.node)
    participant.undeclare_token(pair.reader.guid)
    await until(lambda: not servers_of(pair.client))
    for _ in range(5):  # the client checks for lost requests in a callback of the loop
        await asyncio.sleep(0)
    request = await anext(pair.server)
    request.respond(AddTwoInts.Response(sum=3))
    assert (await calling).sum == 3


@pytest.mark.parametrize(
    ("data", "error"), [(b"\0\1\0\0", DecodeError), (b"\0\1\0", ServerLostError), (b"", ServerLostError)]
)
async def test_response_without_content_raises_decode_error_and_without_header_server_lost_error(
    pair: Pair, data: bytes, error: type[Exception]
) -> None:
    calling = pair.call()
    (gid, number), query = await pair.first_request()
    query.reply(pair.key, data, attachment=pack_attachment(number, 1, gid))
    query.drop()
    with pytest.raises(error):
        await calling


async def test_request_without_header_is_not_retained(pair: Pair) -> None:
    assert await pair.client.wait_for_service(20)
    for data in (b"", b"x", b"\0\1\0"):
        pair.session.get(pair.key, payload=data, attachment=pack_attachment(1, 1, GID))
    pair.session.get(pair.key, payload=bytes((0, 1)) + bytes(18), attachment=pack_attachment(2, 1, GID))
    await until(lambda: pair.reader.queries)
    assert list(pair.reader.queries) == [(GID, 2)]


@pytest.mark.parametrize(("limit", "value"), [("MAX_BYTES", 45), ("MAX_QUERIES", 2)])  # a request has 20 bytes
async def test_oldest_unanswered_requests_are_dropped_above_the_limit(
    pair: Pair, monkeypatch: pytest.MonkeyPatch, limit: str, value: int
) -> None:
    monkeypatch.setattr(services, limit, value)
    assert await pair.client.wait_for_service(20)
    for _ in range(2):  # answered and dropped requests no longer count
        calls = [pair.call() for _ in range(4)]
        requests = [await anext(pair.server) for _ in range(4)]
        for call in calls[:2]:
            with pytest.raises(ServerLostError):
                await call
        for request in requests:
            request.respond(AddTwoInts.Response(sum=3))
        assert [(await call).sum for call in calls[2:]] == [3, 3]


async def test_a_forked_child_drops_its_queries_without_using_zenoh(pair: Pair) -> None:
    calling = pair.call()
    await until(lambda: pair.reader.queries and pair.replies.in_flight)
    pair.reader.detach_after_fork()
    pair.replies.detach_after_fork()
    pair.reader.close()
    pair.replies.cancel(1)
    assert not pair.reader.queries and not pair.replies.in_flight
    await asyncio.sleep(0.1)  # a response would arrive in this time
    assert not calling.done()
    calling.cancel()


async def test_samples_without_valid_attachment_are_dropped_with_a_warning(
    zenoh: World, caplog: pytest.LogCaptureFixture
) -> None:
    node = zenoh.node("n")
    subscription = node.create_subscription(String, "t")
    session: Any = participant_of(node).session
    key, data = (
        f"{node.context.domain_id}/t/std_msgs::msg::dds_::String_/{type_hash(String)}",
        String(data="x").encode(),
    )
    while "expected an attachment of 33 bytes, found none" not in caplog.text:  # at most one per second is logged
        await asyncio.to_thread(session.put, key, data)
        await asyncio.sleep(0.1)
    for payload, attachment in (
        (data, b"\x01" * 33),
        (b"", pack_attachment(1, 1, GID)),
        (data, pack_attachment(2, 1, GID)),
    ):
        await asyncio.to_thread(session.put, key, payload, attachment=attachment)
    assert (await subscription.receive(20)).data == "x"
    assert len(reader_of(subscription).queue.items) == 0
    threads = {record.thread for record in caplog.records if "found none" in record.getMessage()}
    assert threads == {threading.get_ident()}  # the loop's
