"""Memory of the compiler: in proportion to a text that is refused, and to the elements of a definition that is not."""

from __future__ import annotations

import gc
import itertools
import tracemalloc
from pathlib import Path

import pytest
from support.rclpy_messages import hooked, rclpy_class

from rosidl_py_gen import DefinitionError, compile_definition
from rosidl_py_gen.compiler.frontend import idl_parser
from rosidl_py_gen.compiler.frontend.size_limits import MAX_ELEMENTS

LINE = "=" * 80
SIZE = 80_000
NUMBERS = itertools.count()
TEXTS = {
    "fields": lambda i: f"string a{i}\n",
    "sequences": lambda i: f"bool[] a{i}\n",
    "bounded": lambda i: f"string<=5[<=3] a{i}\n",
    "constants": lambda i: f"int8 A{i}=1\n",
    "defaults": lambda i: f"string a{i} 'abc'\n",
    "array defaults": lambda i: f"int8[] a{i} [1,2,3,4,5,6,7,8,9]\n",
    "comments": lambda i: f"int8 a{i} # x [m]\n",
    "types": lambda i: f"{'' if i else 'T0 a'}\n{LINE}\nMSG: memory_msgs/T{i}\n" + f"string a{i}\n" * (i < 400),
    "idl": lambda i: f"string a{i};",
    "idl declarators": lambda i: f"{'' if i else 'short b'},a{i}",
    "idl annotations": lambda i: f"@unit(value='m') @a short a{i};".replace("'", '"'),
}


OTHERS = "strings of an array", "a long default", "half a service", "a comment of idl"


def text_of(case: str, name: str) -> str:
    """Return a definition of the type ``memory_msgs/<kind>/<name>``."""
    match case:
        case "strings of an array":
            return "string[] a ['a'" + ",'a'" * (SIZE // 4) + "]\n"
        case "a long default":
            return "string a '" + "\\'x" * (SIZE // 3) + "'\n"
        case "half a service":
            return "".join(f"string a{i}\n" for i in range(SIZE // 12)) + "---\nbool ok\n"
        case "a comment of idl":
            comment = f"/*{'x ' * 10 * SIZE}*/"
            return f"module memory_msgs {{ module msg {{ {comment} struct {name} {{ short a; }}; }}; }};"
    pieces, size = list[str](), 0
    while size <= SIZE:
        pieces.append(TEXTS[case](len(pieces)))
        size += len(pieces[-1])
    text = "".join(pieces)
    if case.startswith("idl"):
        end = "" if text.endswith(";") else ";"
        return f"module memory_msgs {{ module msg {{ struct {name} {{ {text}{end} }}; }}; }};"
    return text


def peak_of(kind: str, name: str, text: str) -> int:
    """Return the peak of memory, in bytes, while a definition is compiled or refused."""
    gc.collect()
    tracemalloc.start()
    try:
        compile_definition(f"memory_msgs/{kind}/{name}", text)
    except DefinitionError as error:
        assert f"at most {MAX_ELEMENTS} are allowed" in str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return peak


@pytest.mark.parametrize("case", [*TEXTS, *OTHERS])
def test_memory_is_in_proportion_to_a_large_text(case: str) -> None:
    """At most 10 MB and 100 times the size of the text, without imports.

    Two definitions are measured: CPython doubles its table of interned strings from time to time, which takes 7.7 MB at
    330 000 strings, whichever string is the next one. That falls into one of them at most.
    """
    kind = "srv" if case == "half a service" else "msg"
    compile_definition("memory_msgs/msg/First", "string a\n")
    names = [f"Q{next(NUMBERS)}" for _ in range(2)]
    texts = [text_of(case, name) for name in names]
    peaks = [peak_of(kind, name, text) for name, text in zip(names, texts, strict=True)]
    assert min(peaks) < 10e6 + 100 * len(texts[0]), f"{peaks} bytes for {len(texts[0]) >> 10} KiB"


ELEMENTS = 500
"""Elements of the definitions whose memory is measured; at the limit it is four times as much."""
BYTES_PER_ELEMENT = 100_000


def nested(levels: int, field: str, last: str) -> str:
    """Return a definition of fields of nested messages, each of `levels` messages in each other."""
    count = ELEMENTS // (levels + 1)
    types = [field.replace("T", "T1").replace("x", f"x{i}") for i in range(count)]
    for level in range(1, levels + 1):
        types.append(f"{LINE}\nMSG: memory_msgs/T{level}\n")
        types.append(last if level == levels else field.replace("T", f"T{level + 1}"))
    return "".join(types)


COSTLY = {
    "strings": "".join(f"string<=5[<=3] a{i}\n" for i in range(ELEMENTS)),
    "messages in each other": nested(11, "T x\n", "string<=5[<=3] x\n"),
    "loops in each other": nested(4, "T[<=3] x\n", "string<=5[<=3] x\n"),
    "loops of large messages": "".join(f"T[<=3] x{i}\n" for i in range(ELEMENTS))
    + f"{LINE}\nMSG: memory_msgs/T\n"
    + "".join(f"string x{i}\n" for i in range(49)),
    "messages of many fields": "".join(f"T x{i}\n" for i in range(ELEMENTS // 49))
    + f"{LINE}\nMSG: memory_msgs/T\n"
    + "".join(f"string<=5[<=3] x{i}\n" for i in range(48)),
}


@pytest.mark.parametrize("case", COSTLY)
def test_memory_is_in_proportion_to_the_elements(case: str) -> None:
    compile_definition("memory_msgs/msg/First", "string a\n")
    assert peak_of("msg", f"Q{next(NUMBERS)}", COSTLY[case]) < BYTES_PER_ELEMENT * ELEMENTS


def test_memory_of_modules_of_rclpys_api_is_in_proportion_to_the_elements(tmp_path: Path) -> None:
    for name, text in {"First": "string a", "Wide": COSTLY["strings"]}.items():
        path = tmp_path / "memory_msgs" / "msg" / f"{name}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "memory_msgs" / "package.xml").write_text("<package><name>memory_msgs</name></package>")
    with hooked(message_api="rclpy", path=str(tmp_path)):
        rclpy_class("memory_msgs/msg/First")
        gc.collect()
        tracemalloc.start()
        try:
            cls = rclpy_class("memory_msgs/msg/Wide")
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert cls.decode(cls(a7=["x"]).encode()).a7 == ["x"]
    assert peak < BYTES_PER_ELEMENT * ELEMENTS


def test_definitions_end_where_they_would_take_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(idl_parser, "MAX_TOKENS", 30_000)
    frame = "module q_msgs {{ module msg {{ struct Q {{ {} a; }}; }}; }};"
    for text, reason in (
        (frame.format("@a " * 16_000 + "short"), "more than 30000 words and signs"),
        (frame.format("sequence<" * 5000 + "short" + ">" * 5000), "sequences of sequences or arrays are not supported"),
        (frame.format("short") + "module a {" * 5000 + "};" * 5000, "nested too deeply"),
    ):
        with pytest.raises(DefinitionError, match=reason):
            compile_definition("q_msgs/msg/Q", text)
