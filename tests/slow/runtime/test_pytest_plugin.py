"""Pytest fixtures of the package, loaded through the entry point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime import Node

pytest_plugins = ["pytester"]


def test_ros_node_fixture_accepts_its_own_arguments(ros_node: Callable[..., Node]) -> None:
    node = ros_node("relay", args=("--ros-args", "-r", "__ns:=/robot"))
    assert node.fully_qualified_name == "/robot/relay"


FAILING = """
import asyncio
import pytest
from std_msgs.msg import String
from rosidl_py_gen.runtime import Context, Node

def judge(message):
    assert message.data == "right", "wrong word"

async def lead(node, callback, count=1):
    heard = []
    node.create_subscription(String, "chatter", callback)
    node.create_subscription(String, "chatter", heard.append)
    for _ in range(count):
        node.create_publisher(String, "chatter").publish(String(data="hello"))
    while len(heard) < count:
        await asyncio.sleep(0)
    return heard

async def later(message):
    judge(message)

def test_plain(ros_node):
    asyncio.run(lead(ros_node("n"), judge))

def test_async(ros_node):
    async def main():
        await lead(ros_node("n"), later)
        await asyncio.sleep(0)
    asyncio.run(main())

def test_several(ros_node):
    asyncio.run(lead(ros_node("n"), judge, count=2))

def test_own_context(ros_domain):
    with Context(0, transport=ros_domain, args=["test"]) as context:
        asyncio.run(lead(Node("n", context=context), judge))

def test_pytest_fail(ros_node):
    asyncio.run(lead(ros_node("n"), lambda message: pytest.fail("no such word")))

def test_own_failure(ros_node):
    asyncio.run(lead(ros_node("n"), judge))
    raise KeyError("mine")

def test_while_closing(ros_node):
    node = ros_node("n")
    class Part:
        def close(self):
            try:
                judge(String())
            except AssertionError:
                node._scope.report_failure("closing")
    node._scope.register(Part())

def test_expected(ros_node, ros_errors):
    ros_errors.expect(AssertionError, match="wrong word")
    asyncio.run(lead(ros_node("n"), judge))

def test_expected_and_waited_for(ros_node, ros_errors):
    async def main():
        await lead(ros_node("n"), later)
        [error] = await ros_errors.wait()
        assert "wrong word" in str(error)
    asyncio.run(main())
    ros_errors.expect(AssertionError)

def test_expected_in_vain(ros_node, ros_errors):
    ros_errors.expect(ValueError)

def test_other_than_expected(ros_node, ros_errors):
    ros_errors.expect(AssertionError, match="another word")
    asyncio.run(lead(ros_node("n"), judge))

def test_next_one_is_not_blamed(ros_node):
    asyncio.run(lead(ros_node("n"), lambda message: None))
"""


def test_failing_callbacks_fail_the_test_with_their_traceback(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=FAILING)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-rA")
    outcomes = {
        (report.nodeid.rpartition("::")[2], report.when): report.outcome
        for report in result.reprec.getreports("pytest_runtest_logreport")  # type: ignore[attr-defined]
        if report.when == "call" or report.failed
    }
    failed = {name for (name, when), outcome in outcomes.items() if outcome == "failed" and when == "call"}
    assert failed == {f"test_{name}" for name in EXPECTED_TO_FAIL}
    assert {name for (name, when) in outcomes if when == "teardown"} == {"test_while_closing"}
    text = result.stdout.str()
    assert 'assert message.data == "right", "wrong word"' in text
    assert "2 callbacks failed" in text and "callbacks that failed" in text
    assert "no callback raised ValueError, which this test expects" in text


EXPECTED_TO_FAIL = (
    "plain",
    "async",
    "several",
    "own_context",
    "pytest_fail",
    "own_failure",
    "expected_in_vain",
    "other_than_expected",
)


SERVED = """
import asyncio
import pytest
import uvloop
from std_msgs.msg import String
from rosidl_py_gen.runtime import CallbacksNeverRanError, run

LOOP = asyncio.new_event_loop()  # as pytest-asyncio and anyio make theirs, before our fixtures

@pytest.fixture
def heard(ros_node):
    texts, node = [], ros_node("listener")
    node.create_subscription(String, "chatter", lambda message: texts.append(message.data))
    ros_node("talker").create_publisher(String, "chatter").publish(String(data="hello"))
    return texts

async def rest():  # uses no node
    for _ in range(3):
        await asyncio.sleep(0.01)

ENTER = {
    "asyncio": lambda ros_loop: asyncio.run(rest()),
    "earlier loop": lambda ros_loop: LOOP.run_until_complete(rest()),
    "virtual time": lambda ros_loop: ros_loop.run(rest()),
    "uvloop": lambda ros_loop: uvloop.new_event_loop().run_until_complete(rest()),
    "runtime": lambda ros_loop: run(rest()),
}

@pytest.mark.parametrize("kind", ENTER)
def test_served(kind, heard, ros_loop):
    ENTER[kind](ros_loop)
    assert heard == ["hello"]

def test_served_by_the_second_loop(heard, ros_node):
    asyncio.run(asyncio.sleep(0))
    ros_node("talker").create_publisher(String, "chatter").publish(String(data="again"))
    LOOP.run_until_complete(rest())
    assert heard == ["hello", "again"]

def test_unserved(heard):
    pass

def test_unserved_and_closed(ros_node):
    with ros_node("n") as node:
        node.create_timer(1.0, print)

def test_unserved_and_failed(heard):
    assert heard == ["hello"]

def test_expected(heard, ros_errors):
    ros_errors.expect(CallbacksNeverRanError)

def test_no_callbacks(ros_node):
    ros_node("n").create_subscription(String, "chatter")


def test_entities_that_were_closed_or_canceled_need_no_loop(ros_node):
    node = ros_node("closed")
    node.create_timer(1.0, print).cancel()
    node.create_timer(1.0, print).close()
    node.create_subscription(String, "closed", print).close()
"""


def test_callbacks_that_never_ran_fail_the_test_on_any_loop_kind(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(test_it=SERVED)
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "-rA")
    result.assert_outcomes(passed=9, failed=3)
    text = result.stdout.str()
    assert "the callbacks of /listener never ran: no event loop has served the node" in text
    assert "the callbacks of /n never ran" in text and "callbacks that failed" in text
