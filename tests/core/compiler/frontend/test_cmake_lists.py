"""Files of a package according to its CMakeLists.txt, compared with CMake where it is installed."""

# ruff: noqa: E501 - in tables one case is one line
from __future__ import annotations

from pathlib import Path

import pytest
from support.cmake_script import listed_by_cmake, needs_cmake
from support.interface_packages import problems_of, run, write

from rosidl_py_gen.compiler.frontend.search_path import Package, SearchPath

FILES = (
    *("msg/A.msg", "msg/B.msg", "msg/C.msg", "msg/Stray.msg", "msg/ros1/A.msg", "msg/ros2/A.msg", "msg/ros2/D.msg"),
    *("srv/Ask.srv", "action/Do.action", "msg/Given.idl", "elsewhere/msg/E.msg", "msg/notes.txt"),
)
CONTENT = {".msg": "uint8 x\n", ".srv": "---\n", ".action": "---\n---\n", ".txt": "", ".idl": ""}
MANIFEST = {"package.xml": "<package><name>a_msgs</name></package>"}


def package(folder: Path, cmake: str, more: dict[str, str] | None = None) -> Package:
    content = {name: CONTENT[Path(name).suffix] for name in FILES}
    write(folder / "a_msgs", {**content, **MANIFEST, "CMakeLists.txt": cmake, **(more or {})})
    return SearchPath.scan([folder], ament="", bundled=False).packages["a_msgs"]


def taken(found: Package) -> set[str]:
    return {path.relative_to(found.folder).as_posix() for path in found.files.values()}


def notes(found: Package) -> list[str]:
    assert found.listing is not None
    return [str(note).replace(f"{found.folder}/", "") for note in found.listing.notes]


A, B, C, ASK = "msg/A.msg", "msg/B.msg", "msg/C.msg", "srv/Ask.srv"
FOUR = {A, B, C, "msg/Stray.msg"}
CALL = "rosidl_generate_interfaces(${PROJECT_NAME} ${files})"

# Lists that are certain: CMakeLists.txt after project(a_msgs), and the files.
CERTAIN = {
    "literal names": ('rosidl_generate_interfaces(${PROJECT_NAME} "msg/A.msg" srv/Ask.srv)', {A, ASK}),
    "comments": ("rosidl_generate_interfaces(a_msgs # msg/B.msg\n msg/A.msg #[[ msg/C.msg\n]] srv/Ask.srv)", {A, ASK}),
    "capitals": ("ROSIDL_Generate_Interfaces (a_msgs msg/A.msg)", {A}),
    "keywords": (
        "rosidl_generate_interfaces(a_msgs msg/A.msg DEPENDENCIES std_msgs msg/B.msg LIBRARY_NAME x ADD_LINTER_TESTS)",
        {A},
    ),
    "files behind flags and single words": (
        "rosidl_generate_interfaces(a_msgs SKIP_INSTALL msg/A.msg LIBRARY_NAME x msg/B.msg DEPENDENCIES msg/C.msg)",
        {A, B},
    ),
    "another target": ("set(t other)\nrosidl_generate_interfaces(${t} msg/A.msg LIBRARY_NAME ${PROJECT_NAME})", {A}),
    "set": (f'set(files\n  "msg/A.msg" # one\n  msg/B.msg)\n{CALL}', {A, B}),
    "a list in one text": (f'set(files "msg/A.msg;msg/B.msg;")\n{CALL}', {A, B}),
    "brackets": (f"set(files [[msg/A.msg]] [=[msg/B.msg]=])\n{CALL}", {A, B}),
    "a line that goes on": (f'set(files "msg/A.msg;\\\nmsg/B.msg")\n{CALL}', {A, B}),
    "set twice": (f"set(files msg/C.msg)\nset(files msg/A.msg ${{files}})\n{CALL}", {A, C}),
    "a name in a variable": (f"set(n files)\nset(${{n}} msg/A.msg)\nlist(APPEND ${{n}} msg/B.msg)\n{CALL}", {A, B}),
    "append": (f"set(files msg/A.msg)\nset(none)\nlist(APPEND files msg/B.msg ${{none}})\n{CALL}", {A, B}),
    "prepend and insert": (f"list(PREPEND files msg/A.msg)\nlist(INSERT files 0 msg/B.msg)\n{CALL}", {A, B}),
    "sort": (f"set(files msg/B.msg msg/A.msg)\nlist(SORT files)\nlist(REMOVE_DUPLICATES files)\n{CALL}", {A, B}),
    "glob": (f'file(GLOB files RELATIVE "${{CMAKE_CURRENT_SOURCE_DIR}}" msg/*.msg "srv/*.srv")\n{CALL}', {*FOUR, ASK}),
    "glob with other names for here": (
        'set(dir "${PROJECT_SOURCE_DIR}/msg")\nfile(GLOB files RELATIVE ${CMAKE_SOURCE_DIR} ${dir}/[AB].msg ${dir}/?.txt)\n' + CALL,
        {A, B},
    ),
    "glob in all folders": (
        f"file(GLOB_RECURSE files RELATIVE ${{CMAKE_CURRENT_SOURCE_DIR}} CONFIGURE_DEPENDS elsewhere/*.msg srv/*)\n{CALL}",
        {"elsewhere/msg/E.msg", ASK},
    ),
    "a base in front": ('rosidl_generate_interfaces(a_msgs "${CMAKE_CURRENT_SOURCE_DIR}/elsewhere:msg/E.msg")', {"elsewhere/msg/E.msg"}),
    "sub-folders": ("rosidl_generate_interfaces(a_msgs msg/ros2/A.msg msg/ros2/D.msg)", {"msg/ros2/A.msg", "msg/ros2/D.msg"}),
    "idl": ("rosidl_generate_interfaces(a_msgs msg/Given.idl)", {"msg/Given.idl"}),
    "PARENT_SCOPE at the top": (f"set(files msg/A.msg)\nset(files msg/B.msg PARENT_SCOPE)\n{CALL}", {A}),
    "a list that is replaced": (f"set(files msg/Missing.msg)\nset(files msg/A.msg)\n{CALL}", {A}),
    "a list that is replaced by a glob": (f"set(files msg/A.msg)\nfile(GLOB files RELATIVE ${{CMAKE_SOURCE_DIR}} srv/*)\n{CALL}", {ASK}),
    "unset": (f"set(files msg/A.msg)\nunset(files)\nlist(APPEND files msg/B.msg)\n{CALL}", {B}),
    "set to nothing": (f"set(files msg/A.msg)\nset(files)\nlist(APPEND files msg/B.msg)\n{CALL}", {B}),
    "set to an empty text": (f'set(files "")\nset(files ${{files}} msg/B.msg "")\n{CALL}', {B}),
    "a file less": (f"set(files msg/A.msg msg/B.msg msg/C.msg)\nlist(REMOVE_ITEM files msg/B.msg srv/Ask.srv)\n{CALL}", {A, C}),
    "a globbed file less": (
        f'file(GLOB files "${{CMAKE_CURRENT_SOURCE_DIR}}/msg/[ABC].msg")\nlist(REMOVE_ITEM files ${{CMAKE_CURRENT_SOURCE_DIR}}/msg/B.msg)\n{CALL}',
        {A, C},
    ),
    "a prefix for each": (f"set(files A.msg B.msg)\nlist(TRANSFORM files PREPEND msg/)\n{CALL}", {A, B}),
    "a suffix for each": (f"set(files msg/A msg/B)\nlist(TRANSFORM files APPEND .msg)\n{CALL}", {A, B}),
    "names relative to their folder": (
        f"file(GLOB names RELATIVE ${{CMAKE_CURRENT_SOURCE_DIR}}/msg msg/[AB].msg)\nforeach(one ${{names}})\nlist(APPEND files msg/${{one}})\nendforeach()\n{CALL}",
        {A, B},
    ),
    "a loop": (
        'set(names A.msg B.msg)\nset(more "")\nforeach(one ${names})\nlist(APPEND more "msg/${one}")\nendforeach()\nset(names ${more})\n'
        "rosidl_generate_interfaces(a_msgs ${names})",
        {A, B},
    ),
    "a loop over lists and items": (
        f"set(x A B)\nset(y)\nforeach(one IN LISTS x y ITEMS C)\nset(files ${{files}} msg/${{one}}.msg)\nendforeach()\n{CALL}".replace("set(x", "set(files)\nset(x"),
        {A, B, C},
    ),
    "loops in loops": (
        f"foreach(kind msg)\nforeach(one A B)\nlist(APPEND files ${{kind}}/${{one}}.${{kind}})\nendforeach()\nendforeach()\n{CALL}",
        {A, B},
    ),
    "a loop variable that had a value": (f"set(one msg/C.msg)\nforeach(one msg/A.msg)\nendforeach()\nset(files ${{one}})\n{CALL}", {C}),
    "a loop over one text": (f'set(x "a;b")\nforeach(one "${{x}}")\nlist(APPEND files msg/A.msg)\nendforeach()\n{CALL}', {A}),
    "the version of ROS in a variable": (
        "find_package(ros_environment REQUIRED)\nset(ROS_VERSION $ENV{ROS_VERSION})\nset(files A.msg)\nif(${ROS_VERSION} EQUAL 1)\n"
        "add_message_files(FILES ${files})\nelseif(${ROS_VERSION} EQUAL 2)\nset(more)\nforeach(one ${files})\nlist(APPEND more msg/${one})\n"
        "endforeach()\nrosidl_generate_interfaces(a_msgs ${more})\nendif()",
        {A},
    ),
    "the version of ROS as a text": (
        f'if("$ENV{{ROS_VERSION}}" STREQUAL "1")\nset(files msg/ros1/A.msg)\nelse()\nset(files msg/ros2/A.msg)\nendif()\n{CALL}',
        {"msg/ros2/A.msg"},
    ),
    "the version of ROS by name": (
        f"set(ROS_VERSION $ENV{{ROS_VERSION}})\nset(files msg/A.msg)\nif(ROS_VERSION LESS 2 OR NOT DEFINED ENV{{ROS_VERSION}})\nlist(APPEND files msg/B.msg)\nendif()\n{CALL}",
        {A},
    ),
    "the version of ROS in parentheses": (
        f'if(DEFINED ENV{{ROS_VERSION}} AND (($ENV{{ROS_VERSION}} VERSION_GREATER "1.9") AND NOT ($ENV{{ROS_VERSION}} MATCHES "^1")))\nset(files msg/A.msg)\nelse()\nset(files msg/B.msg)\nendif()\n{CALL}',
        {A},
    ),
    "catkin": (f"find_package(catkin QUIET)\nif(catkin_FOUND)\nset(files msg/A.msg)\nelse()\nset(files msg/B.msg)\nendif()\n{CALL}", {B}),
    "ament": (f"find_package(ament_cmake QUIET)\nset(files msg/A.msg)\nif(ament_cmake_FOUND)\nset(files msg/B.msg)\nendif()\n{CALL}", {B}),
    "an early end for ROS 1": (f"set(files msg/A.msg)\nif($ENV{{ROS_VERSION}} EQUAL 1)\nset(files msg/B.msg)\n{CALL}\nreturn()\nendif()\n{CALL}", {A}),
    "an early end for ROS 2": (f"set(files msg/A.msg)\nif($ENV{{ROS_VERSION}} EQUAL 2)\n{CALL}\nreturn()\nendif()\nset(files msg/B.msg)\n{CALL}", {A}),
    "an error that a build does not reach": (f"set(files msg/A.msg)\nif(UNDECIDED_HERE)\nset(files msg/B.msg)\nmessage(FATAL_ERROR no)\nendif()\n{CALL}", {A}),
    "switches of the file": (f"set(WITH_B ON)\nset(WITH_C OFF)\nif(WITH_B)\nlist(APPEND files msg/B.msg)\nendif()\nif(WITH_C)\nlist(APPEND files msg/C.msg)\nendif()\n{CALL}", {B}),
    "the same in both branches": (f"if(UNDECIDED_HERE)\nset(files msg/A.msg)\nelse()\nset(files msg/A.msg)\nendif()\n{CALL}", {A}),
    "overwritten after a condition": (f"if(UNDECIDED_HERE)\nset(files msg/B.msg)\nendif()\nset(files msg/A.msg)\n{CALL}", {A}),
    "one of two calls with one list": (
        f"set(files msg/A.msg)\nif(UNDECIDED_HERE)\n{CALL}\nelse()\n{CALL[:-1]} LIBRARY_NAME other)\nendif()",
        {A},
    ),
    "a function without lists": (f"function(log text)\nmessage(STATUS ${{text}})\nendfunction()\nset(files msg/A.msg)\nlog(now)\n{CALL}", {A}),
    "brackets are taken as they are": (f"set(x msg/B.msg)\nset(files msg/A.msg [[${{x}}/..]])\nlist(REMOVE_ITEM files [[${{x}}/..]])\n{CALL}", {A}),
}  # fmt: skip
MORE = {"more.cmake": "set(files msg/B.msg)\n"}


@pytest.mark.parametrize("case", CERTAIN)
def test_certain_cmake_list_selects_the_files_of_the_package(tmp_path: Path, case: str) -> None:
    cmake, wanted = CERTAIN[case]
    found = package(tmp_path, f"project(a_msgs)\n{cmake}\n", MORE)
    assert (taken(found), notes(found)) == (wanted, [])


@pytest.mark.slow
@needs_cmake
@pytest.mark.parametrize("case", CERTAIN)
def test_cmake_agrees_with_the_expected_file_lists(tmp_path: Path, case: str) -> None:
    cmake, wanted = CERTAIN[case]
    folder = package(tmp_path, cmake, MORE).folder
    assert listed_by_cmake(folder, tmp_path / "script.cmake", cmake) == wanted


IN_FOLDERS = {*FOUR, "srv/Ask.srv", "action/Do.action", "msg/Given.idl"}
ALL = {*IN_FOLDERS, "msg/ros2/D.msg", "elsewhere/msg/E.msg"}
TOO_MUCH = "rosidl_generate_interfaces() has no list of literal names and globs"
EVERYTHING = "all interface files below the package folder are used"
TWICE = '"msg/ros1/A.msg" and 1 more are skipped: "msg/A.msg" defines the same interface'

# Lists that cannot be evaluated completely: CMakeLists.txt, more files of the package, and the interfaces of a build.
GENERATED = "rosidl_generate_interfaces(${PROJECT_NAME} ${files} DEPENDENCIES std_msgs)"
ELSEWHERE = {
    "lists in other files, definitions in sub-folders": (
        f"include(msg_list.txt)\n{GENERATED}",
        {"msg_list.txt": "set(files msg/uav/A.msg)\n", "msg/uav/A.msg": "uint8 x", "srv/uav/B.srv": "---"},
        "msg/A srv/B",
    ),
    "a macro of another file, definitions in another folder": (
        f'include(lists.cmake)\nset(files ros/msg/A.msg)\nadd_lists(${{PROJECT_NAME}} "msg")\n{GENERATED}',
        {
            "lists.cmake": "macro(add_lists name)\nfile(GLOB_RECURSE more ros/${ARGN}/*.msg)\nlist(APPEND files ${more})\nendmacro()",
            "ros/msg/A.msg": "uint8 x",
            "ros/msg/B.msg": "uint8 x",
            "ros/action/C.action": "---\n---",
        },
        "action/C msg/A msg/B",
    ),
    "files that are copied from a folder for each version of ROS": (
        f'file(GLOB new ros2/*)\nfile(COPY ${{new}} Top.msg DESTINATION msg)\nfile(GLOB files RELATIVE "." msg/*)\n{GENERATED}',
        {
            "ros1/A.msg": "time stamp",
            "ros2/A.msg": "builtin_interfaces/Time stamp",
            "ros1/B.msg": "A[] list\nHeader header",
            "ros2/B.msg": "A[] list",
            "Top.msg": "A a",
        },
        "msg/A msg/B msg/Top",
    ),
    "a copied file in a literal list": (
        "file(COPY src/A.msg DESTINATION msg)\nrosidl_generate_interfaces(${PROJECT_NAME} msg/A.msg)",
        {"src/A.msg": "uint8 x"},
        "msg/A",
    ),
    "a loop over files to include": (
        f"file(GLOB_RECURSE files msg/*.msg)\nset(all sub/more.cmake)\nforeach(one ${{all}})\ninclude(${{one}})\nendforeach()\n{GENERATED}",
        {"msg/A.msg": "B b", "sub/more.cmake": "list(APPEND files sub/msg/B.msg)", "sub/msg/B.msg": "uint8 x"},
        "msg/A msg/B",
    ),
    "a macro that is called behind the list": (
        f"macro(more)\nlist(APPEND files msg/B.msg)\nendmacro()\nset(files msg/A.msg)\nmore()\n{GENERATED}",
        {"msg/A.msg": "uint8 x", "msg/B.msg": "uint8 x"},
        "msg/A msg/B",
    ),
    "the call in a sub-folder": (
        "find_package(ament_cmake)\nadd_subdirectory(interfaces)",
        {
            "package.xml": "<package><name>a_msgs</name><member_of_group>rosidl_interface_packages</member_of_group></package>",
            "interfaces/CMakeLists.txt": "rosidl_generate_interfaces(a_msgs msg/A.msg)",
            "interfaces/msg/A.msg": "uint8 x",
        },
        "msg/A",
    ),
    "what is no definition of the package": (
        f"collect(files)\n{GENERATED}",
        {
            "msg/A.msg": "uint8 x",
            "msg/log/B.msg": "uint8 x",
            **{f"{place}/msg/Not.msg": "uint8 x" for place in ("build", "install", "log", "test/build", ".git", "old", "other")},
            "old/COLCON_IGNORE": "",
            "other/package.xml": "<package><name>b_msgs</name></package>",
        },
        "msg/A msg/B",
    ),
}  # fmt: skip


def test_lists_that_cannot_be_evaluated_lose_no_interface(tmp_path: Path) -> None:
    for number, (case, (cmake, files, wanted)) in enumerate(ELSEWHERE.items()):
        folder = write(tmp_path / str(number), {**MANIFEST, "CMakeLists.txt": f"project(a_msgs)\n{cmake}\n", **files})
        found = run(folder, tmp_path / f"out{number}", ["a_msgs"])
        names = [f"{name.kind}/{name.name}" for name in found.names if name.package == "a_msgs"]
        assert " ".join(names) == wanted, case


def test_unreferenced_file_that_does_not_compile_is_skipped_with_a_note(tmp_path: Path) -> None:
    files = {
        "CMakeLists.txt": f"collect(files)\n{CALL}",
        "msg/A.msg": "uint8 x",
        "msg/Use.msg": "Used x",
        "test/Wrong.msg": "int x",
        "test/Unused.msg": "Wrong x\nnix y",
        "msg/Used.msg": "int y",
    }
    folder = write(tmp_path / "in", {**MANIFEST, **files})
    assert [one.partition(' "')[0] for one in problems_of(folder)] == ["msg/Used.msg:1:1:"]
    (folder / "msg" / "Use.msg").unlink()
    (folder / "msg" / "Used.msg").unlink()
    found = run(folder, tmp_path / "out", ["a_msgs"])
    assert [str(name) for name in found.names] == ["a_msgs/msg/A"]
    assert [str(note).replace(f"{folder}/", "").partition(': "')[0] for note in found.notes[1:]] == [
        "test/Unused.msg:2:1: skipped, as no other file refers to it",
        "test/Wrong.msg:1:1: skipped, as no other file refers to it",
    ]
    assert problems_of(folder, ["a_msgs/msg/Wrong"]), "no error was reported to the caller that selected the file"


# Code of other files or functions that adds to a list, after set(files msg/A.msg).
ADDED = {
    "a file of the package": "include(add.cmake)",
    "a file of the package, with its folder": 'include("${CMAKE_CURRENT_LIST_DIR}/add.cmake")',
    "a folder of the package": "add_subdirectory(lists)",
    "a function of a name that is harmless elsewhere": (
        "function(add_b x)\nset(files ${files} msg/B.msg PARENT_SCOPE)\nendfunction()\nset(files msg/A.msg)\nadd_b(files)"
    ),
    "a variable with an unknown name": "list(APPEND ${CMAKE_ARGV0} msg/B.msg)",
    "a variable that a function is given": (
        "function(add_b x)\nlist(APPEND ${x} msg/B.msg)\nset(${x} ${${x}} PARENT_SCOPE)\nendfunction()\nadd_b(files)"
    ),
    "a file that a loop includes": "while(x)\ninclude(add.cmake)\nendwhile()",
    "a file that a macro includes": "macro(more)\ninclude(add.cmake)\nendmacro()\nmore()",
    "a macro of another file, called later": "include(macro.cmake)\nset(files msg/A.msg)\nadd_more()",
    "a macro that composes the name": ("macro(more x y)\nlist(APPEND ${x}${y} msg/B.msg)\nendmacro()\nmore(fi les)"),
    "a macro that another one calls": (
        "macro(one)\nlist(APPEND files msg/B.msg)\nendmacro()\nmacro(two)\none()\nendmacro()\ntwo()"
    ),
    "a variable with the name that a macro changes": (
        "set(n files)\nmacro(more)\nlist(APPEND ${n} msg/B.msg)\nendmacro()\nmore()"
    ),
    "a command that is given its name in a variable": "set(n files)\ncollect(${n} msg/B.msg)",
}
ADDING = {
    "macro.cmake": "macro(add_more)\nlist(APPEND files msg/B.msg)\nendmacro()\n",
    "add.cmake": "list(APPEND files msg/B.msg)\n",
    "lists/CMakeLists.txt": "list(APPEND files msg/B.msg)\nset(files ${files} PARENT_SCOPE)\n",
}


@pytest.mark.parametrize("case", ADDED)
def test_files_added_by_untraceable_code_are_used_with_a_note(tmp_path: Path, case: str) -> None:
    cmake = f"project(a_msgs)\nset(files msg/A.msg)\n{ADDED[case]}\n{CALL}\n"
    found = package(tmp_path, cmake, ADDING)
    assert taken(found) == ALL
    assert [note.partition(": ")[2] for note in notes(found)] == [f"{TOO_MUCH}; {EVERYTHING}", TWICE]


def test_included_files_that_do_not_use_the_list_do_not_change_it(tmp_path: Path) -> None:
    more = {"add.cmake": "find_package(std_msgs)\n", "src/CMakeLists.txt": "add_library(b b.cpp)\n"}
    cmake = f"set(files msg/A.msg)\ninclude(add.cmake)\ninclude(CTest)\nadd_subdirectory(src)\n{CALL}"
    found = package(tmp_path, f"project(a_msgs)\n{cmake}\n", more)
    assert (taken(found), notes(found)) == ({A}, [])


NO_LIST = [f"CMakeLists.txt: {TOO_MUCH}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"]
DEPENDS = "rosidl_generate_interfaces() has a list that depends on the build"


def depends_at(line: int, column: int) -> list[str]:
    return [f"CMakeLists.txt:{line}:{column}: {DEPENDS}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"]


NO_LIST_AT_4 = [f"CMakeLists.txt:4:44: {TOO_MUCH}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"]
# Lists that depend on the build: CMakeLists.txt after project(a_msgs), the files, and the notes.
UNCERTAIN = {
    "a variable of another package": (
        "rosidl_generate_interfaces(a_msgs ${other_msgs_FILES} msg/ros2/D.msg)",
        {*ALL, "msg/ros2/D.msg"},
        [f"CMakeLists.txt:2:35: {TOO_MUCH}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"],
    ),
    "a listed file counts more than one of the folders": (
        "rosidl_generate_interfaces(a_msgs ${other_msgs_FILES} msg/ros2/A.msg)",
        {*ALL - {A}, "msg/ros2/A.msg"},
        [
            f"CMakeLists.txt:2:35: {TOO_MUCH}; {EVERYTHING}",
            'CMakeLists.txt: "msg/A.msg" and 1 more are skipped: "msg/ros2/A.msg" defines the same interface',
        ],
    ),
    "a generator expression": (
        "rosidl_generate_interfaces(a_msgs $<TARGET_OBJECTS:x>)",
        ALL,
        [f"CMakeLists.txt:2:35: {TOO_MUCH}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"],
    ),
    "a command of another package sets it": (
        f"set(files msg/A.msg)\ncollect_files(files msg)\n{CALL}",
        ALL,
        NO_LIST_AT_4,
    ),
    "files that are copied first": (
        f"file(COPY ros2/ DESTINATION msg)\nfile(GLOB files msg/A*)\n{CALL}",
        ALL,
        NO_LIST_AT_4,
    ),
    "a filter that could run away": (
        f'set(files msg/A.msg msg/B.msg)\nlist(FILTER files INCLUDE REGEX "(a*)*b")\n{CALL}',
        ALL,
        NO_LIST_AT_4,
    ),
    "not CMake at all": ('rosidl_generate_interfaces(a_msgs "msg/A.msg)', ALL, NO_LIST),
    "a condition that cannot be decided": (
        f"set(files msg/A.msg)\nif(WIN32)\nlist(APPEND files msg/B.msg msg/C.msg msg/Missing.msg msg/notes.txt)\nendif()\n{CALL}",
        ALL,
        depends_at(2, 11),
    ),
    "a condition around the only call": (
        'if(ROS_EDITION STREQUAL "ROS1")\nelse()\nrosidl_generate_interfaces(a_msgs msg/A.msg)\nendif()',
        {A},
        [],
    ),
    "the call in a loop of unknown length": (
        "while(x)\nrosidl_generate_interfaces(a_msgs msg/A.msg)\nendwhile()",
        {A},
        [],
    ),
    "the call in a file beside it": ("include(rosidl_generate_interfaces.cmake)", ALL, NO_LIST),
    "both ways of a condition": (
        f"if(BUILD_BIG)\nset(files msg/A.msg msg/B.msg)\nelse()\nset(files msg/A.msg msg/C.msg)\nendif()\n{CALL}",
        ALL,
        depends_at(5, 11),
    ),
    "one of two files of one name": (
        f"if(ROS_1)\nset(files msg/ros1/A.msg)\nelse()\nset(files msg/ros2/A.msg)\nendif()\n{CALL}",
        ALL - {A} | {"msg/ros2/A.msg"},
        [
            f"CMakeLists.txt:3:11: {DEPENDS}; {EVERYTHING}",
            'CMakeLists.txt:3:11: "msg/ros1/A.msg" and 1 more are skipped: "msg/ros2/A.msg" defines the same interface',
        ],
    ),
    "more where they are replaced in a block": (
        f"set(files msg/A.msg msg/B.msg)\nif(X)\nset(files ${{files}} msg/C.msg)\nendif()\n{CALL}",
        ALL,
        depends_at(2, 11),
    ),
    "a file less in a block": (
        f"set(files msg/A.msg msg/B.msg)\nif(X)\nlist(REMOVE_ITEM files msg/B.msg)\nendif()\n{CALL}",
        ALL,
        depends_at(2, 11),
    ),
    "a file in a block of the call": (
        "set(more)\nif(X)\nset(more msg/Missing.msg)\nendif()\nrosidl_generate_interfaces(a_msgs msg/A.msg ${more})",
        ALL,
        depends_at(4, 10),
    ),
    "a loop that may end early": (
        f"foreach(one A B)\nlist(APPEND files msg/${{one}}.msg)\nif(X)\nbreak()\nendif()\nendforeach()\n{CALL}",
        ALL,
        [f"CMakeLists.txt:8:44: {TOO_MUCH}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"],
    ),
    "a second call in a block": (
        "rosidl_generate_interfaces(a_msgs msg/A.msg)\nif(X)\nrosidl_generate_interfaces(b msg/B.msg)\nendif()",
        ALL,
        depends_at(4, 30),
    ),
    "a value of the cache": (
        f"set(files msg/A.msg CACHE STRING files)\n{CALL}",
        ALL,
        depends_at(2, 11),
    ),
    "a switch of the user": (
        f"option(BIG text OFF)\nset(files msg/A.msg)\nif(BIG)\nset(files msg/B.msg)\nendif()\n{CALL}",
        ALL,
        depends_at(5, 11),
    ),
    "an unknown name and a wrong one": (
        "rosidl_generate_interfaces(a_msgs msg/Missing.msg msg/notes.txt ${other_msgs_FILES})",
        ALL,
        [f"CMakeLists.txt:2:65: {TOO_MUCH}; {EVERYTHING}", f"CMakeLists.txt: {TWICE}"],
    ),
    "two calls": ("rosidl_generate_interfaces(a msg/A.msg)\nrosidl_generate_interfaces(b msg/B.msg)", {A, B}, []),
    "a call for the package's own tests": (
        "rosidl_generate_interfaces(a_msgs msg/A.msg)\nif(BUILD_TESTING)\n"
        "rosidl_generate_interfaces(t msg/B.msg SKIP_INSTALL)\nendif()",
        {A},
        [],
    ),
    "two files of one name": (
        "rosidl_generate_interfaces(a_msgs msg/A.msg msg/ros2/A.msg msg/A.msg)",
        {A},
        ['CMakeLists.txt:2:45: "msg/ros2/A.msg" is skipped: "msg/A.msg" defines the same interface'],
    ),
    "files outside of the package": (
        "rosidl_generate_interfaces(a_msgs msg/A.msg ../../etc/X.msg /etc/Y.msg msg/../../Z.msg)",
        {A},
        [
            f'CMakeLists.txt:2:{column}: "{name}" is not in the package folder; skipped'
            for column, name in ((45, "../../etc/X.msg"), (61, "/etc/Y.msg"), (72, "msg/../../Z.msg"))
        ],
    ),
}


@pytest.mark.parametrize("case", UNCERTAIN)
def test_uncertain_list_means_all_files_and_a_note_but_no_error(tmp_path: Path, case: str) -> None:
    cmake, wanted, expected_notes = UNCERTAIN[case]
    found = package(tmp_path, f"project(a_msgs)\n{cmake}\n")
    assert (taken(found), notes(found)) == (wanted, expected_notes)
    assert found.listing is not None and found.listing.problems == []


# Names of carla_msgs, whose lists for ROS 1 and 2 are made in one file.
CARLA = """cmake_minimum_required(VERSION 2.8.3)
project(a_msgs)
find_package(ros_environment REQUIRED)
set(ROS_VERSION $ENV{ROS_VERSION})
set(MSG_FILES A.msg B.msg)
set(SERVICE_FILES Ask.srv)
if(${ROS_VERSION} EQUAL 1)
  find_package(catkin REQUIRED COMPONENTS message_generation std_msgs)
  add_message_files(DIRECTORY msg FILES ${MSG_FILES})
  catkin_package(CATKIN_DEPENDS message_runtime std_msgs)
elseif(${ROS_VERSION} EQUAL 2)
  if(NOT CMAKE_CXX_STANDARD)
    set(CMAKE_CXX_STANDARD 14)
  endif()
  find_package(ament_cmake REQUIRED)
  set(TEMP_LIST "")
  foreach(MSG_FILE ${MSG_FILES})
    list(APPEND TEMP_LIST "msg/${MSG_FILE}")
  endforeach()
  set(MSG_FILES ${TEMP_LIST})
  set(TEMP_LIST "")
  foreach(SERVICE_FILE ${SERVICE_FILES})
    list(APPEND TEMP_LIST "srv/${SERVICE_FILE}")
  endforeach()
  set(SERVICE_FILES ${TEMP_LIST})
  rosidl_generate_interfaces(${PROJECT_NAME} ${MSG_FILES} ${SERVICE_FILES} DEPENDENCIES std_msgs ADD_LINTER_TESTS)
  ament_package()
endif()
"""


def test_files_of_carla_msgs_are_listed_by_its_ros_2_branch(tmp_path: Path) -> None:
    found = package(tmp_path / "in", CARLA)
    assert (taken(found), notes(found)) == ({A, B, ASK}, [])
    assert problems_of(tmp_path / "in") == []


def test_kind_of_a_listed_file_is_determined_by_its_suffix(tmp_path: Path) -> None:
    found = package(tmp_path, "rosidl_generate_interfaces(a_msgs msg/ros2/A.msg elsewhere/msg/E.msg)")
    assert [str(name) for name in found.files] == ["a_msgs/msg/A", "a_msgs/msg/E"]


@pytest.mark.parametrize(
    ("cmake", "problem"),
    [
        (
            "set(files\n  msg/A.msg\n  msg/Mising.msg)\nrosidl_generate_interfaces(a_msgs ${files})",
            'a_msgs/CMakeLists.txt:3:3: "msg/Mising.msg" is listed here, but there is no such file',
        ),
        (
            "set(names Cc.msg)\nset(files msg/${names})\nrosidl_generate_interfaces(a_msgs ${files})",
            'a_msgs/CMakeLists.txt:2:11: "msg/Cc.msg" is listed here, but there is no such file; did you mean "C.msg"?',
        ),
        (
            "rosidl_generate_interfaces(a_msgs msg/notes.txt)",
            'a_msgs/CMakeLists.txt:1:35: "msg/notes.txt" is not an interface file (.msg, .srv, .action or .idl)',
        ),
    ],
)
def test_wrong_list_entry_is_an_error_with_location(tmp_path: Path, cmake: str, problem: str) -> None:
    package(tmp_path / "in", cmake)
    assert problems_of(tmp_path / "in") == [problem]


def test_wrong_list_entry_does_not_affect_other_interfaces(tmp_path: Path) -> None:
    package(tmp_path / "in", "rosidl_generate_interfaces(a_msgs msg/A.msg msg/Missing.msg)")
    assert problems_of(tmp_path / "in", ["a_msgs/msg/A"]) == []


def test_invalid_file_that_is_not_listed_is_ignored(tmp_path: Path) -> None:
    package(tmp_path / "in", "rosidl_generate_interfaces(a_msgs msg/A.msg)", {"msg/Stray.msg": "Header wrong\n"})
    assert [str(name) for name in run(tmp_path / "in", tmp_path / "out").names] == ["a_msgs/msg/A"]


def test_use_of_an_unlisted_file_is_an_error_that_explains_it(tmp_path: Path) -> None:
    package(tmp_path / "in", "rosidl_generate_interfaces(a_msgs msg/A.msg)", {"msg/A.msg": "Stray x\n"})
    why = "msg/Stray.msg is there, but CMakeLists.txt does not list it"
    assert problems_of(tmp_path / "in") == [f'a_msgs/msg/A.msg:1:1: unknown type "a_msgs/Stray"; {why}']
    (problem,) = problems_of(tmp_path / "in", ["a_msgs/msg/Stray"])
    assert problem.startswith(f"a_msgs/msg/Stray: no interface of this name; {why}")


def test_links_directly_in_msg_may_lead_out_of_the_package(tmp_path: Path) -> None:
    shared = write(tmp_path / "shared", {"msg/L.msg": ""}) / "msg" / "L.msg"
    found = package(tmp_path / "in", "rosidl_generate_interfaces(a_msgs msg/A.msg msg/L.msg msg/ros2/L.msg)")
    for place in ("msg/L.msg", "msg/ros2/L.msg"):
        (found.folder / place).symlink_to(shared)
    assert taken(found) == {A, "msg/L.msg"}
    assert notes(found) == ['CMakeLists.txt:1:55: "msg/ros2/L.msg" is not in the package folder; skipped']


def test_all_listed_files_may_be_in_other_folders(tmp_path: Path) -> None:
    cmake = "rosidl_generate_interfaces(b_msgs topics/msg/T.msg)"
    files = {"package.xml": "<package><name>b_msgs</name></package>", "CMakeLists.txt": cmake, "topics/msg/T.msg": ""}
    found = SearchPath.scan([write(tmp_path / "b", files)], ament="", bundled=False)
    assert [str(name) for name in found.packages["b_msgs"].files] == ["b_msgs/msg/T"]


@pytest.mark.parametrize("cmake", ["add_message_files(FILES A.msg)", "# rosidl\n", ""])
def test_without_a_list_all_files_of_the_interface_folders_count(tmp_path: Path, cmake: str) -> None:
    found = package(tmp_path, cmake)
    assert (found.listing, taken(found)) == (None, IN_FOLDERS)


def test_installed_packages_and_folders_without_manifest_ignore_cmake_lists(tmp_path: Path) -> None:
    cmake = "rosidl_generate_interfaces(a_msgs msg/A.msg)"
    installed = write(tmp_path / "prefix/share/a_msgs", {A: "", B: "", **MANIFEST, "CMakeLists.txt": cmake})
    plain = write(tmp_path / "plain/b_msgs", {A: "", B: "", "CMakeLists.txt": cmake})
    found = SearchPath.scan([plain], ament=str(tmp_path / "prefix"), bundled=False)
    assert {name: len(one.files) for name, one in found.packages.items()} == {"a_msgs": 2, "b_msgs": 2}
    assert installed != plain
