"""Handlers of action servers: threads, completion and closing."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import pytest
from fibonacci_action import Fibonacci, feedback, goal, pair, result
from support.folders import ROOT, TESTS
from support.waiting import until
from support.worlds import World

from rosidl_py_gen.errors import ClosedError
from rosidl_py_gen.runtime.actions.states import GoalStatus

S = GoalStatus


@pytest.mark.slow
@pytest.mark.parametrize(
    ("style", "handler"),
    [("run", "until_cancelled"), ("run", "for_ever"), ("asyncio", "until_cancelled"), ("spin", "for_ever")],
)
def test_ctrl_c_stops_program_whose_handler_runs_in_a_thread(style: str, handler: str) -> None:
    script = TESTS / "support/ctrl_c_process.py"
    root = str(ROOT)
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, str(script), style, handler]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env)
    try:
        assert process.stdout is not None and process.stdout.readline() == b"executing\n"
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    if style != "asyncio":  # which lets KeyboardInterrupt through
        assert b"KeyboardInterrupt" not in errors
        # Python 3.10 does not report who cancelled a task, so interrupted handlers are logged.
        assert b"Traceback" not in errors or sys.version_info < (3, 11)
    assert process.returncode == (0 if style != "asyncio" else -signal.SIGINT)
    assert b"Task was destroyed" not in errors and b"Fatal" not in errors


async def test_closing_server_requests_cancel_of_plain_handlers(world: World, caplog: pytest.LogCaptureFixture) -> None:
    outcomes: list[Any] = []
    entered = threading.Event()

    def execute(handle: Any) -> Any:
        entered.set()
        while not handle.is_cancel_requested:
            time.sleep(0.005)
        with pytest.raises(ClosedError):
            handle.publish_feedback(feedback(1))
        try:
            handle.canceled(result(1))
        except ClosedError as error:
            outcomes.append(error)
            raise

    server, client = await pair(world, execute)
    await client.send_goal(goal())
    await until(entered.is_set)
    server.close()
    await until(lambda: len(outcomes) == 1)
    await asyncio.sleep(0.01)
    assert "failed" not in caplog.text


@pytest.mark.every_transport
async def test_closing_server_cancels_async_handlers(world: World) -> None:
    seen: list[bool] = []
    entered = asyncio.Event()

    async def execute(handle: Any) -> Any:
        entered.set()
        try:
            await asyncio.sleep(30)
        finally:
            seen.append(handle.is_cancel_requested)

    server, client = await pair(world, execute)
    await client.send_goal(goal())
    await asyncio.wait_for(entered.wait(), 20)
    server.close()
    server.close()
    await until(lambda: seen == [True])


async def cancelled_future(handle: Any) -> Any:
    waiting = asyncio.get_running_loop().create_future()
    waiting.cancel()
    await waiting


def cancelled_error(handle: Any) -> Any:
    raise asyncio.CancelledError


def stop_iteration(handle: Any) -> Any:
    return next(iter(()))


@pytest.mark.parametrize("execute", [cancelled_future, cancelled_error, stop_iteration])
async def test_handler_that_raises_aborts_its_goal(
    world: World, caplog: pytest.LogCaptureFixture, execute: Any
) -> None:
    server, client = await pair(world, execute)
    status, got = await (await client.send_goal(goal())).result(timeout_s=5)
    assert (status, list(got.sequence), server.goals) == (S.ABORTED, [], [])
    assert "the execute function of action /fib failed" in caplog.text and "Traceback" in caplog.text


async def test_forty_plain_handlers_run_in_parallel(world: World) -> None:
    """asyncio's own pool has six threads on two processors: the seventh goal was EXECUTING and did not run."""

    together = threading.Barrier(40)

    def execute(handle: Any) -> Any:
        together.wait(10)
        return result(handle.request.order)

    _, client = await pair(world, execute)
    handles = [await client.send_goal(goal(number)) for number in range(40)]
    ends = [await handle.result(timeout_s=10) for handle in handles]
    assert [(status, list(got.sequence)) for status, got in ends] == [(S.SUCCEEDED, [n]) for n in range(40)]


async def test_result_modified_after_goal_end_is_sent_unmodified(world: World) -> None:
    results: list[Any] = []

    async def execute(handle: Any) -> Any:
        results.append(result(1, 2))
        handle.succeed(results[0])
        results[0].sequence = [9]

    _, client = await pair(world, execute)
    handle = await client.send_goal(goal())
    assert list((await handle.result(timeout_s=5))[1].sequence) == [1, 2]
    result_client = world.node().create_client(Fibonacci.GetResult, "fib/_action/get_result")
    request = Fibonacci.GetResult.Request()
    request.goal_id.uuid = handle.goal_id
    again = await result_client.call(request, timeout_s=5)
    assert (again.status, list(again.result.sequence)) == (4, [1, 2])


async def test_unencodable_result_raises_error_with_field_name(world: World) -> None:
    errors: list[str] = []

    async def execute(handle: Any) -> Any:
        try:
            handle.succeed(result(2**40))
        except ValueError as error:
            errors.append(str(error))
        return result(1)

    _, client = await pair(world, execute)
    assert (await (await client.send_goal(goal())).result(timeout_s=5))[0] is S.SUCCEEDED
    assert errors[0].startswith("example_interfaces/action/Fibonacci_Result.sequence")


async def test_plain_handler_can_publish_feedback_and_succeed_from_its_thread(world: World) -> None:
    main_thread = threading.get_ident()

    def execute(handle: Any) -> Any:
        assert threading.get_ident() != main_thread
        handle.publish_feedback(feedback(1))
        with pytest.raises(Exception, match="cannot canceled"):
            handle.canceled()
        return handle.succeed(result(3))

    _, client = await pair(world, execute)
    handle = await client.send_goal(goal())
    assert [list(item.sequence) async for item in handle.feedback()] == [[1]]
    assert list((await handle.result())[1].sequence) == [3]
