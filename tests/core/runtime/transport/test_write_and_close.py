"""Contexts that close while other threads or an interrupted thread use them raise errors and do not crash."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest
from support.inner_state import participant_of

from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import ClosedError, Context, LoopRunner, Node
from rosidl_py_gen.runtime.transport.cyclone import discovery

if TYPE_CHECKING:
    from support.worlds import World

STRING: Any = get_message("std_msgs/msg/String")


def test_domain_is_deleted_only_after_writing_threads_finished(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    context = Context(discovery="localhost")
    publisher = Node("n", context=context).create_publisher(STRING, "t")
    participant = participant_of(publisher)
    api, domain = participant.api, participant.domain
    message, order, errors = STRING(data="x" * 100_000), list[str](), list[str]()
    copy, end = api.copy_large, domain.end_if_unused
    began = threading.Event()

    def slow(*arguments: Any) -> Any:
        began.set()
        while not domain.is_closing:
            time.sleep(0.001)  # until the other thread closes the domain
        order.append("copied")
        return copy(*arguments)

    def publish() -> None:
        try:
            publisher.publish(message)
        except ClosedError as error:
            errors.append(str(error))

    monkeypatch.setattr(api, "copy_large", slow)
    monkeypatch.setattr(domain, "end_if_unused", lambda: (order.append("ended"), end()))
    thread = threading.Thread(target=publish)
    thread.start()
    assert began.wait(20)
    context.close()
    thread.join(20)
    assert order[0] == "copied" and "ended" in order
    assert errors == ["the writer of rt/t is closed"] and domain.writing == []
    with pytest.raises(ClosedError):
        publisher.publish(message)


def test_context_close_waits_for_a_thread_that_reads_discovery(dds: World, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        LoopRunner() as runner,
        Context(discovery="localhost", loop_runner=runner) as context,
        dds.node("other") as other,
    ):
        Node("n", context=context)
        reading, closed, ends = threading.Event(), threading.Event(), list[bool]()
        look = discovery.topic_key_of

        def slow(name: str) -> Any:
            if threading.current_thread() is thread:
                reading.set()
                ends.append(closed.wait(0.05))
            return look(name)

        thread = threading.Thread(target=runner.wait, args=(reading.is_set, 20))
        monkeypatch.setattr(discovery, "topic_key_of", slow)
        other.create_publisher(STRING, "t")
        thread.start()
        assert reading.wait(20)
        context.close()
        closed.set()
        thread.join(20)
        assert ends and not any(ends)


CLOSES_IN_A_HANDLER = """
import signal, sys
from rosidl_py_gen import get_message
from rosidl_py_gen.runtime import ClosedError, Context, Node

string = get_message("std_msgs/msg/String")
context = Context(discovery="localhost")
publisher = Node("n", context=context).create_publisher(string, "t")
signal.signal(signal.SIGALRM, lambda *_: context.close())
signal.setitimer(signal.ITIMER_REAL, float(sys.argv[1]))
try:
    while True:
        publisher.publish(string(data="x"))
except ClosedError as error:
    print(error)
with Context(discovery="localhost") as context:  # the domain can be joined again
    Node("n", context=context).create_publisher(string, "t").publish(string(data="x"))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_signal_handler_can_close_the_context_of_an_interrupted_publish(dds: World) -> None:
    for number in range(4):
        command = [sys.executable, "-c", CLOSES_IN_A_HANDLER, str(0.05 + number / 450)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert (done.returncode, done.stderr) == (0, ""), done
        assert "closed" in done.stdout
