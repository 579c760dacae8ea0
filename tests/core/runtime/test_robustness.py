"""Closed objects, stopped servers, wrong arguments."""

from __future__ import annotations

import asyncio
import gc
import signal
import time
from typing import TYPE_CHECKING, Any

import pytest
from std_msgs.msg import String, UInt8MultiArray
from std_srvs.srv import SetBool
from support.inner_state import participant_of, reader_of
from support.processes import python_process
from support.waiting import rests, until

from rosidl_py_gen import compile_definition
from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime import CallTimeoutError, TransportError

if TYPE_CHECKING:
    from support.worlds import World


async def test_waiting_on_closed_entities_raises_closed_error_without_cpu_use(world: World) -> None:
    context = world.context()
    node = world.node("gone", context=context)
    publisher, client = node.create_publisher(String, "t"), node.create_client(SetBool, "s")
    context.close()
    for attempt in (
        publisher.wait_for_subscribers(timeout_s=20),
        client.wait_for_service(timeout_s=20),
        node.wait_for_node("other", timeout_s=20),
        node.__aenter__(),
        context.__aenter__(),
    ):
        with pytest.raises(ClosedError):
            await attempt
    assert await rests(0.5, cpu_s=0.2)


def test_nested_fetch_of_a_reader_preserves_sample_order(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    from rosidl_py_gen.runtime.transport.cyclone import endpoints as cyclone_endpoints

    node = dds.node("n")
    api, readers = participant_of(node).api, list[Any]()
    unref = api.serdata_unref

    def interrupted(sample: int) -> None:
        assert not readers[0].fetch()  # newer samples must not overtake
        readers[1].fetch()
        unref(sample)

    other = node.create_subscription(String, "other")
    with monkeypatch.context() as patched:
        patched.setattr(api, "serdata_unref", interrupted)
        first = node.create_subscription(String, "first")
    readers += [reader_of(first), reader_of(other)]
    publishers = [node.create_publisher(String, topic) for topic in ("first", "other")]
    known = dict(cyclone_endpoints.local_readers)
    cyclone_endpoints.local_readers.clear()  # so that several samples wait in DDS
    for number in range(5):
        for publisher in publishers:
            publisher.publish(String(data=f"{publisher.topic} {number} {'x' * number}"))
    cyclone_endpoints.local_readers.update(known)
    assert readers[0].fetch()
    for subscription, topic in ((first, "/first"), (other, "/other")):
        texts = [String.decode(sample[0]).data for sample in reader_of(subscription).queue.items]
        assert texts == [f"{topic} {number} {'x' * number}" for number in range(5)]


@pytest.mark.slow
async def test_calls_to_a_stopped_server_time_out_in_parallel(dds: World, caplog: pytest.LogCaptureFixture) -> None:
    program = (
        "import asyncio\nfrom rosidl_py_gen.runtime import Node\n"
        "async def main():\n    async with Node('stalled') as node:\n"
        "        node.create_service('rcl_interfaces/srv/DescribeParameters', 'd', lambda r: {})\n"
        "        print(flush=True)\n        await asyncio.Event().wait()\n"
        "asyncio.run(main())\n"
    )
    from rosidl_py_gen.msgs.rcl_interfaces.srv import DescribeParameters

    with python_process(program) as server:
        assert server.stdout is not None
        server.stdout.readline()
        client = dds.node("caller").create_client(DescribeParameters, "d")
        assert await client.wait_for_service(timeout_s=10)
        server.send_signal(signal.SIGSTOP)
        request = DescribeParameters.Request(names=["x" * 1_000_000])
        started = time.monotonic()
        calls = [asyncio.ensure_future(client.call(request, timeout_s=1)) for _ in range(20)]
        outcomes = await asyncio.gather(*calls, return_exceptions=True)
        assert time.monotonic() - started < 15  # sequential calls would take 20 s
        assert all(isinstance(outcome, CallTimeoutError) for outcome in outcomes)
        pending = [asyncio.ensure_future(client.call(request, timeout_s=60)) for _ in range(3)]
        await until(lambda: client.in_flight_count == 3)
        client.close()
        ends = await asyncio.gather(*pending, return_exceptions=True)
        assert all(isinstance(end, ClosedError) for end in ends)
        assert client.in_flight_count == 0
    gc.collect()
    assert not [record for record in caplog.records if "never retrieved" in record.getMessage()]


@pytest.mark.parametrize(
    ("timeout", "error"),
    [("1", TypeError), (float("nan"), ValueError), ([], TypeError), (True, TypeError), (-1, ValueError)],
)
async def test_invalid_timeout_is_refused(memory: World, timeout: Any, error: type[Exception]) -> None:
    node = memory.node("n")
    client, subscription = node.create_client(SetBool, "s"), node.create_subscription(String, "t")
    publisher = node.create_publisher(String, "t")
    for attempt in (
        client.call(SetBool.Request(), timeout_s=timeout),
        client.wait_for_service(timeout),
        subscription.receive(timeout),
        subscription.wait_for_publishers(timeout),
        publisher.wait_for_acknowledged(timeout),
        node.wait_for_node("x", timeout),
    ):
        with pytest.raises(error, match="timeout_s must be"):
            await attempt
    assert client.in_flight_count == 0


def test_arguments_of_wrong_type_are_refused_with_a_hint(memory: World) -> None:
    node = memory.node("n")
    with pytest.raises(TypeError, match=r"the callback of /t must be a function, got 10; QoS is given as qos="):
        node.create_subscription(String, "t", 10)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="the handler of service /s must be a function, got 5"):
        node.create_service(SetBool, "s", 5)  # type: ignore[call-overload]
    assert node.get_topic_names_and_types() == memory.node("other").get_topic_names_and_types()
    publisher = node.create_publisher(UInt8MultiArray, "raw")
    for wrong in (None, "hi", 5, [0, 1, 0, 0, 5]):
        with pytest.raises(TypeError, match="publish_raw takes bytes"):
            publisher.publish_raw(wrong)  # type: ignore[arg-type]


def test_overlong_dds_type_name_is_refused(dds: World) -> None:
    node = dds.node("n")
    for length, fits in ((235, True), (236, False), (1000, False)):  # `my_pkg::msg::dds_::…_`
        message = compile_definition(f"my_pkg/msg/L{'o' * (length - 1)}", "int32 x")
        if fits:
            node.create_publisher(message, "long").publish(message())
        else:
            with pytest.raises(TransportError, match="expected at most 255 characters, got"):
                node.create_publisher(message, "long")
