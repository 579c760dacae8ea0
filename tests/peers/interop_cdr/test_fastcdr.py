"""Exchange of encoded messages with eProsima Fast-CDR, the library of rmw_fastrtps.

Needs g++ and Debian's libfastcdr-dev (Fast-CDR 1, the encoding of Humble; its wstring is also that of Jazzy's type
support, docs/internals/protocol.md 2.2). With ROSIDL_TEST_REQUIRE_PEERS=1 a missing compiler or library is a failure,
else a skip.
"""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.definition_strategies import values
from support.example_counts import examples
from support.reference_cdr import NUMBERS, Reference, same

from rosidl_py_gen import compile_definition, decode, encode
from rosidl_py_gen.base.fieldtype import Arity, FieldType
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.model import SourceText
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, check
from rosidl_py_gen.compiler.frontend.search_path import SearchPath

SOURCE = Path(__file__).with_name("fastcdr_peer.cpp")
REQUIRED = os.environ.get("ROSIDL_TEST_REQUIRE_PEERS") == "1"

# The structs of fastcdr_peer.cpp.
SHAPES = {
    "Numbers": "bool a|uint8 b|int8 c|int16 d|uint8 e|uint16 f|uint8 g|int32 h|uint8 i|uint32 j|uint8 k|int64 l|"
    "uint8 m|uint64 n|byte o|float32 p|char q|float64 r",
    "Small": "uint8 a|uint16 b",
    "Wide": "uint8 a|float64 b|uint8 c",
    "Text": "uint8 a|string b|uint16 c|string<=20 d|float64 e",
    "WideText": "uint8 a|wstring b|uint8 c|wstring<=20 d|float64 e",
    "Arrays": "uint8 a|uint8[3] b|float64[2] c|int16[3] d|bool[3] e|string[2] f|uint64[2] g",
    "Sequences": "uint8 a|uint8[] b|float64[] c|uint8 d|bool[] e|int16[<=4] f|uint64[] g|float32[] h|uint8 i",
    "Texts": "string[] a|uint8 b|wstring[] c|string<=12[<=3] d|uint64 e",
    "Nested": "uint8 a|Wide b|Small c|Wide d|uint8 e|Text f|uint8 g",
    "Lists": "uint8 a|Small[] b|Wide[] c|Text[] d|Wide[2] e|uint32 f",
    "Deep": "uint8 a|Lists[] b|Nested c|Sequences[<=3] d",
    "Stamp": "int32 sec|uint32 nanosec",
    "Header": "Stamp stamp|string frame_id",
    "JointState": "Header header|string[] name|float64[] position|float64[] velocity|float64[] effort",
}
TEXTS = {f"fastcdr/msg/{name}": text.replace("|", "\n") + "\n" for name, text in SHAPES.items()}


def reference() -> Reference:
    library = InterfaceRegistry(SearchPath({}, [], []))
    for name, text in TEXTS.items():
        library.add_text(RosName.parse(name), SourceText(f"<{name}>", text, "msg"))
    check(library, [RosName.parse(name) for name in TEXTS])
    library.raise_diagnostics()
    return Reference(library.message)


REFERENCE = reference()


def message_class(shape: str) -> type[Any]:
    parts = [TEXTS[f"fastcdr/msg/{shape}"]]
    parts += [
        f"MSG: {name.replace('/msg/', '/')}\n{text}" for name, text in TEXTS.items() if not name.endswith("/" + shape)
    ]
    return compile_definition(f"fastcdr/msg/{shape}", ("=" * 80 + "\n").join(parts))


class Peer:
    """The C++ program, asked line by line."""

    def __init__(self, program: Path) -> None:
        self.process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def ask(self, request: str) -> str:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(request + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        assert answer, f"the peer ended at: {request[:200]}"
        return answer.strip()

    def close(self) -> None:
        self.process.communicate(timeout=10)


@pytest.fixture(scope="session")
def peer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Peer]:
    program = tmp_path_factory.mktemp("fastcdr") / "peer"
    compiler = shutil.which("g++")
    problem = "g++ is not installed"
    if compiler:
        command = [compiler, "-std=c++17", "-O1", str(SOURCE), "-o", str(program), "-lfastcdr"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        missing = "fastcdr/Cdr.h: No such file" in done.stderr or "cannot find -lfastcdr" in done.stderr
        problem = "libfastcdr-dev is not installed" if missing else ""
        assert missing or done.returncode == 0, done.stderr
    if problem:
        if REQUIRED:
            pytest.fail(f"{problem}, and ROSIDL_TEST_REQUIRE_PEERS=1 asks for it")
        pytest.skip(f"{problem}; ROSIDL_TEST_REQUIRE_PEERS=1 makes this a failure")
    running = Peer(program)
    yield running
    running.close()


# --- values as the peer spells them -----------------------------------------------------------------------------------


def spell(kind: FieldType, value: Any) -> list[str]:
    if kind.arity is not Arity.SCALAR:
        count = [] if kind.arity is Arity.ARRAY else [str(len(value))]
        return count + [token for one in value for token in spell(kind.element, one)]
    if kind.base == "string":
        return ["s" + value.encode().hex()]
    if kind.base == "wstring":
        return ["w" + value.encode("utf-16-be").hex()]
    if kind.base in ("float32", "float64"):
        letter = NUMBERS[kind.base][0]
        return [format(int.from_bytes(struct.pack(">" + letter, value), "big"), "x")]
    return [str(int(value))] if kind.base in NUMBERS else spell_message(kind.base, value)


def spell_message(name: str, value: dict[str, Any]) -> list[str]:
    return [token for item in REFERENCE.definition(name).fields for token in spell(item.type, value[item.name])]


def without_nul(value: Any) -> Any:
    """Fast-CDR 1 writes C strings: a NUL ends them, so strings here have none."""
    if isinstance(value, dict):
        return {key: without_nul(item) for key, item in value.items()}
    if isinstance(value, list):
        return [without_nul(item) for item in value]
    return value.replace("\0", "0") if isinstance(value, str) else value


@pytest.mark.parametrize("shape", [shape for shape in SHAPES if shape != "Stamp"])
@settings(max_examples=examples(60), suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_encoding_and_decoding_agree_with_fastcdr(peer: Peer, shape: str, data: st.DataObject) -> None:
    name = f"fastcdr/msg/{shape}"
    value = without_nul(data.draw(values(REFERENCE, name)))
    cls = message_class(shape)
    encoded = encode(REFERENCE.build(cls, value))
    tokens = " ".join(spell_message(name, value))
    assert peer.ask(f"read {shape} {encoded.hex()}") == tokens
    peer_bytes = bytes.fromhex(peer.ask(f"write {shape} {tokens}"))
    assert peer_bytes.hex() == encoded.hex()
    assert same(REFERENCE.plain(decode(cls, peer_bytes)), value)
    big = bytes.fromhex(peer.ask(f"write_big {shape} {tokens}"))
    assert big[:2] == b"\0\0"
    assert same(REFERENCE.plain(decode(cls, big)), value)


def test_fastcdr_refuses_truncated_messages(peer: Peer) -> None:
    cls = message_class("Text")
    encoded = encode(cls(1, "text", 2, "more", 0.5))
    assert peer.ask(f"read Text {encoded.hex()}") != "refused"
    for size in range(4, len(encoded)):
        assert peer.ask(f"read Text {encoded[:size].hex()}") == "refused"
