"""Classes from the definitions in bags and MCAP files, in the ros2msg and in the IDL format."""

from __future__ import annotations

from typing import Any

import pytest
from support.inner_state import type_fields

from rosidl_py_gen import (
    Action,
    DefinitionError,
    Message,
    Service,
    compile_definition,
    decode,
    encode,
    get_message,
    type_hash,
)

LINE = "=" * 80


def test_definition_may_be_followed_by_the_definitions_it_uses() -> None:
    cls = compile_definition(
        "text/msg/Top",
        f"Middle middle\n{LINE}\nMSG: text/Middle\nother_text/Leaf[] leaves\n"
        f"{LINE}\nMSG: other_text/Leaf\nstring name\n",
    )
    leaf = type_fields(type_fields(cls)[0].cls)[0].cls
    message = cls()
    message.middle.leaves = [leaf("x")]
    assert encode(message).hex() == "00010000" + "01000000" + "02000000" + "7800"


@pytest.mark.parametrize("separator", ["=" * 8, "=" * 80, "=" * 80 + "  ", "=" * 200])
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("header", ["MSG: text2/Inner", "MSG:  text2/Inner ", "MSG: text2/msg/Inner"])
def test_separators_and_line_endings_may_vary(separator: str, newline: str, header: str) -> None:
    text = newline.join(["uint8 a", "Inner inner", separator, header, "uint8 b", ""])
    cls = compile_definition("text2/msg/Outer", text)
    assert encode(cls()).hex() == "000100000000"


def test_definition_text_may_begin_with_the_header_of_its_first_definition() -> None:
    text = f"{LINE}\nMSG: text3/Top\nLeaf leaf\n{LINE}\nMSG: text3/Leaf\nuint16 x 7\n"
    assert encode(compile_definition("text3/msg/Top", text)()).hex() == "000100000700"


def test_equals_signs_inside_a_definition_do_not_separate() -> None:
    cls = compile_definition("text4/msg/Top", f"# {LINE}\nuint8 X=1\nstring S=========\nuint8 a\n")
    assert (cls.X, cls.S) == (1, "========")


def test_types_missing_from_the_text_are_found_on_the_search_path() -> None:
    cls = compile_definition("text5/msg/Top", "std_msgs/Header header\ngeometry_msgs/Point[] points\n")
    assert type(cls().header) is get_message("std_msgs/msg/Header")


def test_definitions_in_the_text_override_the_search_path() -> None:
    cls = compile_definition("text6/msg/Top", f"std_msgs/Header header\n{LINE}\nMSG: std_msgs/Header\nuint32 seq\n")
    assert encode(cls()).hex() == "00010000" + "00000000"
    assert type(cls().header) is not get_message("std_msgs/msg/Header")


def test_services_and_actions_are_read_by_the_kind_in_the_name() -> None:
    service: Any = compile_definition(
        "text7/srv/Add", f"int64 a\nPart part\n---\nint64 sum\n{LINE}\nMSG: text7/Part\nuint8 x\n"
    )
    assert issubclass(service, Service)
    assert encode(service.Request(a=1)).hex() == "00010000" + "0100000000000000" + "00"
    assert encode(service.Response(2)).hex() == "00010000" + "0200000000000000"
    action: Any = compile_definition("text7/action/Count", "uint8 to\n---\nuint8[] all\n---\nuint8 now\n")
    assert issubclass(action, Action)
    assert encode(action.Goal(3)).hex() == "0001000003"
    assert encode(action.FeedbackMessage()).hex() == "00010000" + "00" * 17
    request: Any = compile_definition("text7/msg/Add_Request", "int64 a\n")
    assert issubclass(request, Message)


IDL = """// a comment
#include "text8/msg/Leaf.idl"
module text8 {
  module msg {
    typedef double double__3[3];
    module Top_Constants {
      const uint8 LIMIT = 5;
      const string NAME = "top";
    };
    @verbatim (language="comment", text="What it is.")
    struct Top {
      @verbatim (language="comment", text="The leaf.")
      text8::msg::Leaf leaf;
      @default (value=7)
      uint8 number;
      sequence<string<5>, 3> words;
      double__3 triple;
      sequence<octet> raw;
      boolean flag;
      wstring wide;
      long long big;
    };
  };
};
"""
LEAF = 'module text8 { module msg { struct Leaf { float x; @unit(value="m") uint16 y; }; }; };\n'


def test_idl_text_compiles_to_the_class_of_the_equal_msg_text() -> None:
    idl = compile_definition("text8/msg/Top", f"{IDL}{LINE}\nIDL: text8/msg/Leaf\n{LEAF}")
    msg_text = (
        "uint8 LIMIT=5\nstring NAME=top\nLeaf leaf\nuint8 number 7\nstring<=5[<=3] words\nfloat64[3] triple\n"
        f"byte[] raw\nbool flag\nwstring wide\nint64 big\n{LINE}\nMSG: text8/Leaf\nfloat32 x\nuint16 y\n"
    )
    assert compile_definition("text8/msg/Top", msg_text) is idl
    assert (idl.LIMIT, idl.NAME, idl().number) == (5, "top", 7)
    other = compile_definition("text9/msg/Top", msg_text.replace("text8", "text9"))
    assert type_hash(other) != type_hash(idl)
    one, twin = (
        cls(number=3, words=["a", "bcd"], triple=[1.0, 2.0, 3.0], raw=b"xyz", flag=True, wide="w€", big=-1)
        for cls in (idl, other)
    )
    assert encode(one) == encode(twin)
    assert decode(idl, encode(twin)) == one
    empty = "module text8 { module msg { struct Nothing { uint8 structure_needs_at_least_one_member; }; }; };"
    assert type_fields(compile_definition("text8/msg/Nothing", empty)) == ()


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("uint8 a\nuint8 a\n", "<text10/msg/Top>:2:"),
        ("unknown_pkg/Thing x\n", "<text10/msg/Top>:1:1"),
        ("Top x\n", "<text10/msg/Top>:1:"),
        (f"Other x\n{LINE}\nMSG: text10/Other\nuint8 a\nuint99 b\n", "<text10/msg/Other>:2:1"),
        (f"uint8 a\n{LINE}\nMSG: Not/A/Name/At/All\nuint8 b\n", "<text10/msg/Top>:3:1"),
        (f"A x\n{LINE}\nMSG: text10/A\nB x\n{LINE}\nMSG: text10/B\nA x\n", "<text10/msg/"),
        ("module text10 { module msg { struct Top { uint8 a } }; };", "<text10/msg/Top>:1:"),
    ],
)
def test_errors_state_the_location_in_the_invalid_definition(text: str, where: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        compile_definition("text10/msg/Top", text)
    assert str(caught.value.diagnostics[0]).startswith(where), str(caught.value)


def test_failed_compilation_does_not_affect_later_compilations() -> None:
    with pytest.raises(DefinitionError):
        compile_definition("text11/msg/Top", f"Leaf x\nuint99 y\n{LINE}\nMSG: text11/Leaf\nuint8 a\n")
    assert (
        encode(compile_definition("text11/msg/Top", f"Leaf x\n{LINE}\nMSG: text11/Leaf\nuint8 a\n")()).hex()
        == "0001000000"
    )
