"""Lists of random CMakeLists.txt files equal the list of CMake, or are uncertain, which means all files."""

# ruff: noqa: E501 - in tables one case is one line
from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.cmake_script import listed_by_cmake, needs_cmake
from support.example_counts import examples
from support.interface_packages import write

from rosidl_py_gen.compiler.frontend.cmake_interfaces import CMakeInterfaceList

FILES = [f"{kind}/{name}.{kind}" for kind in ("msg", "srv") for name in "ABC"]
NAMES = st.sampled_from(["x", "y", "z"])
ITEMS = st.lists(
    st.sampled_from([*FILES, "${x}", "${y}", '"${z}"', "msg/${n}.msg", '"${d}/A.srv"', '"msg/A.msg;srv/B.srv"', '""']),
    max_size=3,
).map(" ".join)
CONDITIONS = st.sampled_from(
    [
        *("$ENV{ROS_VERSION} EQUAL 1", '"$ENV{ROS_VERSION}" STREQUAL "2"', "${v} VERSION_LESS 2.1", "v LESS 2 OR v EQUAL 2"),
        *("NOT v EQUAL 2", "DEFINED ENV{ROS_VERSION}", "NOT DEFINED x", "x", "NOT x", '"${n}" MATCHES "^A"', "n STREQUAL A"),
        *("(v EQUAL 1) OR ((v EQUAL 2) AND TRUE)", "ON", "FALSE", "UNDECIDED", "UNDECIDED OR ON", "UNDECIDED AND OFF"),
        *("catkin_FOUND", "ament_cmake_FOUND", "other_FOUND", "x STREQUAL y", "msg/A.msg IN_LIST x", "EXISTS ${d}"),
        *('"${x}" STREQUAL ""', "x MATCHES A AND NOT y", "v GREATER_EQUAL 2 AND OFF OR ON", "n LESS 3", "WIN32"),
    ]
)  # fmt: skip
COMMANDS = st.one_of(
    st.builds("set({} {})".format, NAMES, ITEMS),
    st.builds("set({} {} PARENT_SCOPE)".format, NAMES, ITEMS),
    st.builds('set({} {} CACHE STRING "")'.format, NAMES, st.sampled_from(FILES)),
    st.builds("unset({})".format, NAMES),
    st.builds("list({} {} {})".format, st.sampled_from(["APPEND", "PREPEND", "REMOVE_ITEM"]), NAMES, ITEMS),
    st.builds("list(INSERT {} 0 msg/C.msg {})".format, NAMES, ITEMS),
    st.builds("list({} {})".format, st.sampled_from(["SORT", "REVERSE", "REMOVE_DUPLICATES"]), NAMES),
    st.builds('set({0} "")\nlist(APPEND {0} {1})\nlist(TRANSFORM {0} {2})'.format, NAMES, ITEMS, st.sampled_from(["PREPEND msg/../", 'APPEND ""', 'REPLACE A B', "TOLOWER"])),
    st.builds("file(GLOB {} RELATIVE ${{CMAKE_CURRENT_SOURCE_DIR}} {})".format, NAMES, st.sampled_from(["msg/*.msg", "*/A.*", "srv/[AB].srv", "none/*"])),
    st.builds("file(GLOB_RECURSE {} {})".format, NAMES, st.sampled_from(["B.*", "${CMAKE_CURRENT_SOURCE_DIR}/srv/C*"])),
    st.builds("set(n {})".format, st.sampled_from(["A", "B", "", "A B"])),
    st.builds("set(v {})".format, st.sampled_from(["1", "2", "$ENV{ROS_VERSION}", "2.1"])),
    st.builds("set({} {})\nset(${{{}}} {})".format, st.just("p"), NAMES, st.just("p"), ITEMS),
    st.builds("change({} {})".format, NAMES, ITEMS),
    st.builds("add({} {})".format, NAMES, ITEMS),
    st.builds("find_package({})".format, st.sampled_from(["catkin QUIET", "ament_cmake REQUIRED", "other REQUIRED"])),
    st.builds("string(REPLACE A B {} \"${{{}}}\")".format, NAMES, NAMES),
    st.sampled_from(["return()", "rosidl_generate_interfaces(a_msgs ${x})", "include(more.cmake)"]),
)  # fmt: skip
LINES = st.lists(COMMANDS, max_size=5).map("\n".join)
BLOCKS = st.recursive(
    LINES,
    lambda inner: st.one_of(
        st.builds("{}\nif({})\n{}\nelseif({})\n{}\nelse()\n{}\nendif()\n{}".format, inner, CONDITIONS, inner, CONDITIONS, inner, inner, inner),
        st.builds("{}\nif({})\n{}\nendif()".format, inner, CONDITIONS, inner),
        st.builds("foreach(n {})\n{}\nendforeach()\n{}".format, st.sampled_from(["A B", "${x}", "IN LISTS y z", "IN ITEMS A ${z}", "RANGE 1", '"${x}"', "A B C"]), inner, inner),
        st.builds("foreach(n A B)\n{}\nif({})\n{}()\nendif()\n{}\nendforeach()".format, inner, CONDITIONS, st.sampled_from(["break", "continue"]), inner),
        st.builds("function(change_{1} p)\n{0}\nset(${{p}} ${{y}} PARENT_SCOPE)\nendfunction()\nchange_{1}({1})".format, inner, NAMES),
        st.builds("macro(macro_{1} p)\n{0}\nlist(APPEND ${{p}} msg/B.msg)\nendmacro()\nmacro_{1}({1})".format, inner.filter(lambda text: "return" not in text), NAMES),
        st.builds("set(i)\nwhile(NOT i)\nset(i ON)\n{}\nendwhile()".format, inner),
    ),
    max_leaves=8,
)  # fmt: skip
HEAD = """set(v 2)
set(n A)
set(d srv)
set(x msg/A.msg)
set(y msg/B.msg srv/C.srv)
set(z)
function(change p)
  set(${p} ${ARGN} msg/C.msg PARENT_SCOPE)
endfunction()
macro(add p)
  list(APPEND ${p} ${ARGN})
  set(${p}_done 1)
endmacro()
"""
CALL = "rosidl_generate_interfaces(a_msgs ${x} ${y} ${z})"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    files = {name: "---" if name.endswith("srv") else "" for name in FILES}
    return write(tmp_path_factory.mktemp("cmake") / "a_msgs", {**files, "more.cmake": "set(y srv/A.srv)\n"})


@needs_cmake
@settings(max_examples=examples(150), deadline=None)
@given(body=BLOCKS)
def test_a_random_list_equals_the_list_of_cmake_or_means_all_files(body: str, folder: Path) -> None:
    cmake = f"{HEAD}{body}\n{CALL}\n"
    wanted = listed_by_cmake(folder, folder.parent / "script.cmake", cmake)
    if not wanted:
        return  # CMake ends before the call, or the list is empty
    write(folder, {"CMakeLists.txt": f"project(a_msgs)\n{cmake}"})
    listing = CMakeInterfaceList("a_msgs", folder)
    taken = {path.relative_to(folder).as_posix() for path in listing.files.values()}
    existing = {name for name in wanted if name in FILES}
    if listing.complete:
        assert taken == existing
    else:
        assert taken == set(FILES)
        assert listing.problems == []
