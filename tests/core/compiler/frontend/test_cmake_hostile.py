"""A CMakeLists.txt is untrusted: no crash, bounded time and memory, no reads outside the package."""

# ruff: noqa: E501 - in tables one case is one line
from __future__ import annotations

import builtins
import os
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.example_counts import examples
from support.interface_packages import write

from rosidl_py_gen.compiler.frontend.cmake_interfaces import CMakeInterfaceList
from rosidl_py_gen.compiler.frontend.search_path import Package, SearchPath

MANIFEST = "<package><name>a_msgs</name></package>"
CALL = "rosidl_generate_interfaces(a_msgs ${x} msg/A.msg)\n"
MAX_S = 10.0  # each file takes less than 1 s
MAX_BYTES = 100 << 20


def package(folder: Path, cmake: str | bytes) -> Package:
    write(folder / "a_msgs", {"package.xml": MANIFEST, "msg/A.msg": "", "CMakeLists.txt": cmake})
    return SearchPath.scan([folder], ament="", bundled=False).packages["a_msgs"]


def parentheses(count: int) -> str:
    return "if(" + "(" * count + ")" * count + ")\nendif()\n" + CALL


def many_calls(count: int) -> str:
    return CALL * count


def long_line(count: int) -> str:
    return "\nrosidl_generate_interfaces(a_msgs " + " ".join(f"{i}.msg" for i in range(count)) + ")\n"


nested = "if(a)\n" * 30 + "endif()\n" * 30
HOSTILE = {
    "doubling": "set(x aaaaaaaa)\n" + 'set(x "${x}${x}")\n' * 60 + CALL,
    "doubling a list": "set(x a;a)\n" + "list(APPEND x ${x})\n" * 60 + CALL,
    "blocks in blocks": nested + CALL,
    "undecidable conditions": "".join(f"if(u{i})\nset(x{i} a)\nset(x ${{x}};{i})\nendif()\n" for i in range(4000)) + CALL,
    "references in references": "${" * 100_000 + CALL,
    "references that multiply": "".join(f"if(u{i})\nset(v{i} a)\nelse()\nset(v{i} b)\nendif()\n" for i in range(99))
    + "set(x " + "".join(f"${{v{i}}}" for i in range(99)) + ")\n" + CALL,
    "parentheses": parentheses(50_000),
    "slow patterns": "".join(f"file(GLOB x {'*a' * 40} */../{'*/' * 90})\n" for _ in range(2000)) + CALL,
    "patterns in all folders": "file(GLOB_RECURSE x * */* *.msg)\n" * 3000 + CALL,
    "many missing files": "rosidl_generate_interfaces(a_msgs " + " ".join(f"msg/M{i}.msg" for i in range(15_000)) + ")",
    "many notes": "rosidl_generate_interfaces(a_msgs " + " ".join(f"../M{i}.msg" for i in range(15_000)) + ")",
    "many calls": many_calls(5000),
    "quotation marks": '"' * 100_001 + CALL,
    "brackets": "[" + "=" * 100_000 + "[" + CALL,
    "bracket comments": "#[[" * 80_000 + CALL,
    "backslashes": "set(x " + "\\" * 100_001 + ")\n" + CALL,
    "longer than it may be": "#" * (1 << 20) + "\n" + CALL,
    "control characters": "set(x \0 \1 \x1b[31m /\1/../../etc)\n" + CALL,
    "not text": b"rosidl_generate_interfaces(\xff\xfe\x00 ${x} \x80)",
    "own folder changed": "set(CMAKE_CURRENT_SOURCE_DIR /etc ${u})\nfile(GLOB x *)\ninclude(passwd)\n" + CALL,
    "one list, element by element": "".join(f"list(APPEND x m{i})\n" for i in range(45_000)) + CALL,
    "one list in a block": "if(u)\n" + "".join(f"set(x m{i})\n" for i in range(45_000)) + "endif()\n" + CALL,
    "one text many times": f"set(v [[{'a' * 500_000}]])\nset(x z{'${v}' * 100_000})\n" + CALL,
    "one text many times, quoted": f'set(v [[{"a" * 500_000}]])\nset(x "z{"${v}" * 100_000}")\n' + CALL,
    "one long line below another": long_line(10_000),
    "as many files as it can name": "rosidl_generate_interfaces(a_msgs " + " ".join(f"{i}.msg" for i in range(95_000)) + ")",
    "a long path": f"rosidl_generate_interfaces(a_msgs [[{'a/' * 500_000}X.msg]])",
    "patterns in no folder": "".join(f"file(GLOB x q/{i}*)\n" for i in range(45_000)) + CALL,
    "patterns of stars": "".join(f"file(GLOB x {i}{'*a' * 1900})\n" for i in range(250)) + CALL,
    "the same file again": "include(CMakeLists.txt)\nadd_subdirectory(.)\n" * 20_000 + CALL,
    "heads without arguments": "foreach()\nendforeach()\nset()\nlist()\nfile()\nlist(APPEND)\nfile(GLOB)\nunset()\nproject()\n"
    "find_package()\noption()\ninclude()\nfunction()\nendfunction()\nif()\nendif()\nlist(FILTER x)\nlist(TRANSFORM x)\n"
    "file(GLOB x RELATIVE)\nset(x PARENT_SCOPE)\nset(x CACHE)\nadd_subdirectory()\nbreak()\ncontinue()\nmessage()\n" + CALL,
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files_end_soon(tmp_path: Path, case: str) -> None:
    found = package(tmp_path, HOSTILE[case])
    start = time.process_time()
    assert all(path.is_relative_to(found.folder) for path in found.files.values())
    assert time.process_time() - start < MAX_S


SHARE = 5
"""Tracing of allocations is slow, so long inputs are a fifth as long, with a fifth of the bound."""
TRACED = {
    **{
        case: (HOSTILE[case], MAX_BYTES)
        for case in (
            *("doubling", "doubling a list", "references that multiply", "many missing files"),
            *("one text many times", "one text many times, quoted"),
        )
    },
    "parentheses": (parentheses(50_000 // SHARE), MAX_BYTES // SHARE),
    "many calls": (many_calls(5000 // SHARE), MAX_BYTES // SHARE),
    "one long line below another": (long_line(10_000 // SHARE), MAX_BYTES // SHARE),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", TRACED)
def test_hostile_files_need_little_memory(tmp_path: Path, case: str) -> None:
    text, max_bytes = TRACED[case]
    found = package(tmp_path, text)
    tracemalloc.start()
    try:
        assert found.files is not None
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < max_bytes, f"{most >> 20} MiB"


WORDS = st.sampled_from(
    [
        *("set", "list", "file", "if", "elseif", "else", "endif", "foreach", "endforeach", "function", "endfunction"),
        *("macro", "endmacro", "while", "endwhile", "include", "add_subdirectory", "return", "break", "continue", "f"),
        *("rosidl_generate_interfaces", "project", "find_package", "option", "unset", "string", "message", "block"),
    ]
)
ARGUMENTS = st.lists(
    st.sampled_from(
        [
            *("x", "y", "f", "${x}", '"${y}"', "${${x}}", "$ENV{ROS_VERSION}", "$<x>", "msg/A.msg", "../../etc/passwd"),
            *("APPEND", "GLOB", "GLOB_RECURSE", "RELATIVE", "FILTER", "INCLUDE", "REGEX", "TRANSFORM", "PREPEND", "IN"),
            *("LISTS", "ITEMS", "PARENT_SCOPE", "CACHE", "FORCE", "NOT", "AND", "OR", "(", ")", "EQUAL", "STREQUAL"),
            *("MATCHES", "DEFINED", "EXISTS", "IN_LIST", "VERSION_LESS", "1", "0", "OFF", '"a;b"', "*", "**/*.msg"),
            *("CMakeLists.txt", ".", "..", "${CMAKE_CURRENT_SOURCE_DIR}", "/", "${x", "}", "\\", '"', "[[", "]]", "#"),
            *(
                "DEPENDENCIES",
                "LIBRARY_NAME",
                "SKIP_INSTALL",
                "CMAKE_CURRENT_SOURCE_DIR",
                "${CMAKE_CURRENT_SOURCE_DIR}:x",
            ),
        ]
    ),
    max_size=6,
)
COMMANDS = st.builds(lambda name, arguments: f"{name}({' '.join(arguments)})", WORDS, ARGUMENTS)
BLOCKS = st.recursive(
    st.lists(COMMANDS, max_size=4).map("\n".join),
    lambda inner: st.builds(
        lambda kind, head, body, more: f"{kind}({' '.join(head)})\n{body}\nend{kind}()\n{more}",
        st.sampled_from(["if", "foreach", "function", "macro", "while"]),
        ARGUMENTS,
        inner,
        inner,
    ),
    max_leaves=8,
)


@settings(max_examples=examples(300))
@given(text=st.one_of(BLOCKS, st.text(max_size=200), st.lists(COMMANDS, max_size=12).map("\n".join)))
def test_any_cmake_text_yields_only_files_of_the_package_and_printable_notes(
    text: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.getbasetemp() / "any"
    write(folder, {"msg/A.msg": "", "CMakeLists.txt": f"{text}\n{CALL}".encode(errors="replace")})
    listing = CMakeInterfaceList("a_msgs", folder)
    assert all(path.is_relative_to(folder) and path.is_file() for path in listing.files.values())
    assert all(os.path.normpath(path) == str(path) for path in listing.files.values())
    assert all("\1" not in note.text and "\0" not in note.text for note in (*listing.notes, *listing.problems))


OUTSIDE = [
    "include({secret}/x.cmake)",
    "include(../../secret/x.cmake)",
    "include(link/x.cmake)",
    "add_subdirectory(../../secret)",
    "add_subdirectory(link)",
    "file(GLOB x ../../secret/* {secret}/* ../../*/*)",
    "file(GLOB x link/* link/msg/A.*)",
    "file(GLOB x link/../../*)",
    "file(GLOB_RECURSE x *)",
    "file(GLOB_RECURSE x link/*)",
    "if(EXISTS {secret}/msg/A.msg OR EXISTS ../../secret OR EXISTS link/msg)\nset(x msg/A.msg)\nendif()",
    "set(CMAKE_CURRENT_SOURCE_DIR {secret})\nfile(GLOB x *)\ninclude(x.cmake)",
    "set(x ../../secret/msg/A.msg {secret}/msg/A.msg {secret}:msg/A.msg link/msg/A.msg link:msg/B.msg)",
]


def test_cmake_file_that_is_a_link_out_of_the_package_is_not_read(tmp_path: Path) -> None:
    secret = write(tmp_path / "secret", {"CMakeLists.txt": f"rosidl_generate_interfaces(a msg/Secret.msg)\n{CALL}"})
    found = package(tmp_path / "in", "")
    (found.folder / "CMakeLists.txt").unlink()
    (found.folder / "CMakeLists.txt").symlink_to(secret / "CMakeLists.txt")
    listing = CMakeInterfaceList("a_msgs", found.folder)
    assert [note.text for note in listing.notes] == [
        "the file lies outside the package folder; all interface files below the package folder are used"
    ]
    assert not listing.problems


@pytest.mark.parametrize("cmake", OUTSIDE)
def test_no_file_outside_of_the_package_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cmake: str) -> None:
    files = {"x.cmake": "set(x msg/A.msg)", "msg/A.msg": "", "msg/B.msg": "", "CMakeLists.txt": "set(x msg/A.msg)"}
    secret = write(tmp_path / "secret", files)
    found = package(tmp_path / "in", f"set(x)\n{cmake.format(secret=secret)}\n{CALL}")
    (found.folder / "link").symlink_to(secret)
    touched: list[str] = []

    def watched(real: Callable[..., Any]) -> Callable[..., Any]:
        def watching(path: Any = ".", *more: Any, **named: Any) -> Any:
            touched.append(os.path.realpath(path))
            return real(path, *more, **named)

        return watching

    with monkeypatch.context() as patch:
        for module, name in ((os, "scandir"), (os, "listdir"), (builtins, "open")):
            patch.setattr(module, name, watched(getattr(module, name)))
        files_taken = found.files
    assert touched, "nothing was read at all"
    home = os.path.realpath(found.folder)
    assert [path for path in touched if not Path(path).is_relative_to(home)] == []
    assert [path for path in files_taken.values() if not Path(os.path.realpath(path)).is_relative_to(home)] == []
