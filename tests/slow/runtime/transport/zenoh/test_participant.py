"""Participants when Zenoh refuses an operation."""

from __future__ import annotations

import os
import select
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
import zenoh

from rosidl_py_gen.runtime.transport.api import EndpointSpec, ServiceSpec, TopicKey, TransportError
from rosidl_py_gen.runtime.transport.middleware_threads import ReadyItems
from rosidl_py_gen.runtime.transport.qos import DEFAULT
from rosidl_py_gen.runtime.transport.zenoh import endpoints
from rosidl_py_gen.runtime.transport.zenoh.participant import ZenohParticipant

if TYPE_CHECKING:
    from collections.abc import Callable

    from rosidl_py_gen.runtime.transport.api import Participant

TOPIC = EndpointSpec(TopicKey("topic", "/t"), "T", DEFAULT)
SERVICE = ServiceSpec("/s", "p/srv/X", "", "", "", DEFAULT)


class Session:
    """Session of Zenoh that does nothing and refuses the functions in `refused`."""

    def __init__(self) -> None:
        self.refused: set[str] = set()
        self.calls: list[str] = []

    def __getattr__(self, name: str) -> Callable[..., Any]:
        def call(*_: object, **__: object) -> Any:
            self.calls.append(name)
            if name in self.refused:
                raise zenoh.ZError("no")
            return self

        return call

    def zid(self) -> str:
        return "1a"


@pytest.mark.parametrize(
    ("refused", "create"),
    [
        ("declare_publisher", lambda one: one.create_writer(TOPIC)),
        ("declare_subscriber", lambda one: one.create_reader(TOPIC)),
        ("declare_querier", lambda one: one.create_client(SERVICE)),
        ("declare_queryable", lambda one: one.create_server(SERVICE)),
        ("declare_token", lambda one: one.create_writer(replace(TOPIC, node=1))),
    ],
)
def test_endpoint_refused_by_zenoh_raises_transport_error(
    refused: str, create: Callable[[Participant], object]
) -> None:
    session = Session()
    participant = ZenohParticipant(session, 0, "/")
    participant.announce({1: SimpleNamespace(name="n", namespace="/")})  # type: ignore[dict-item]
    session.refused = {refused}
    with pytest.raises(TransportError, match=r"Zenoh could not create an endpoint of .*/[ts]\S* at 0/[ts]/.*: no"):
        create(participant)
    assert (session.calls[-1] == "undeclare") == (refused == "declare_token")
    participant.close()


@pytest.mark.parametrize("is_refused", [True, False])
def test_closed_or_failed_buffer_reader_leaves_no_zenoh_subscriber(
    is_refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = Session()
    participant = ZenohParticipant(session, 0, "/")
    if is_refused:

        def refuse(key: str) -> str:
            raise zenoh.ZError("no")

        monkeypatch.setattr(endpoints, "cpu_buffer_key", refuse)
        with pytest.raises(TransportError):
            participant.create_reader(replace(TOPIC, has_buffer=True))
    else:
        participant.create_reader(replace(TOPIC, has_buffer=True)).close()
    own = session.calls[session.calls.index("liveliness") + 2 :]  # the first subscriber receives the liveliness tokens
    assert own.count("declare_subscriber") == own.count("undeclare") == (1 if is_refused else 2)


def test_session_is_closed_although_zenoh_refuses_to_undeclare() -> None:
    session = Session()
    participant = ZenohParticipant(session, 0, "/")
    for _ in range(2):
        participant.create_writer(TOPIC)
    session.refused = {"undeclare", "close"}
    participant.close()
    assert session.calls.count("undeclare") == 3 and session.calls[-1] == "close"
    assert participant.fileno() is None


def test_ready_items_after_close_are_not_written_to_a_reused_descriptor() -> None:
    ready = ReadyItems()
    ready.put(lambda: None)
    watched = ready.fileno()
    assert watched is not None and select.select([watched], [], [], 0)[0]
    assert len(ready.take()) == 1 and not select.select([watched], [], [], 0)[0]
    ready.close()
    pipes = [os.pipe()]
    while watched not in pipes[-1]:  # until the number is reused
        pipes.append(os.pipe())
    pipes.append(os.pipe())
    ready.put(lambda: None)
    try:
        assert not select.select([reading for reading, _ in pipes], [], [], 0)[0]
    finally:
        for end in (end for pipe in pipes for end in pipe):
            os.close(end)
