"""When all servers of a client are known to have answered."""

from __future__ import annotations

from typing import Any

from rosidl_py_gen.runtime.endpoints.answering import Answering


class OneByteNames:
    """A graph in which the first byte of a GUID names its participant."""

    def participant_of(self, guid: bytes) -> bytes:
        return guid[:1]


def answering() -> Answering:
    graph: Any = OneByteNames()
    return Answering(graph)


def test_nobody_has_answered_while_there_is_no_server() -> None:
    servers = answering()
    assert not servers.all_have()
    servers.heard(b"A2")
    assert not servers.all_have()


def test_each_server_has_to_answer() -> None:
    servers = answering()
    servers.reach({b"A1", b"B1"})
    servers.heard(b"A2")
    assert not servers.all_have()
    servers.heard(b"B2")
    assert servers.all_have()
    servers.reach({b"B1"})
    assert servers.all_have()


def test_a_server_that_is_made_anew_in_its_process_has_to_answer_again() -> None:
    servers = answering()
    servers.reach({b"A1"})
    servers.heard(b"A2")
    assert servers.all_have()
    servers.reach({b"A3"})
    assert not servers.all_have()
    servers.heard(b"A4")
    assert servers.all_have()


def test_answers_of_two_servers_of_one_process_are_not_told_apart() -> None:
    servers = answering()
    servers.reach({b"A1", b"A3"})
    servers.heard(b"A2")
    servers.heard(b"A4")
    assert not servers.all_have()
