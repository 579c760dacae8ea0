"""Search paths: packages, their order, selections with dependencies, and reports of broken references."""

# ruff: noqa: E501 - in tables one case is one line
from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.interface_packages import problems_of, write

from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.base.resources import GeneratedCode, InstalledInterfaces
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry, select
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import LoadedInterfaces
from rosidl_py_gen.errors import DefinitionError, Diagnostic, TypeNotFoundError

POINT = {"a_msgs/msg/Point.msg": "float64 x"}


def packages(search: SearchPath) -> dict[str, str]:
    return {name: one.origin for name, one in search.packages.items()}


def only(folder: Path) -> SearchPath:
    return SearchPath.scan([folder], ament="", bundled=False)


# --- folders for --path -------------------------------------------------------------------------------------------------


def test_search_path_entry_may_be_a_folder_of_packages_or_one_package(tmp_path: Path) -> None:
    write(tmp_path, {**POINT, "b_msgs/srv/Ask.srv": "---", "c/action/Do.action": "---\n---"})
    assert set(packages(only(tmp_path))) == {"a_msgs", "b_msgs", "c"}
    assert packages(only(tmp_path / "a_msgs")) == {"a_msgs": str(tmp_path / "a_msgs")}
    with pytest.raises(DefinitionError, match="expected a folder with interface packages, found none"):
        only(tmp_path / "nowhere")


def test_workspace_packages_are_found_at_any_depth(tmp_path: Path) -> None:
    files = {
        "repository/interfaces/a_msgs/package.xml": "<package><name>a_msgs</name></package>",
        "repository/interfaces/a_msgs/msg/Point.msg": "float64 x",
        "repository/driver/package.xml": "<package><name>driver</name></package>",
        "repository/driver/src/msg/NotAPackage.msg": "float64 x",  # below a package there are no packages
        ".hidden/b_msgs/msg/Point.msg": "float64 x",
    }
    found = only(write(tmp_path, files))
    assert set(packages(found)) == {"a_msgs"}


@pytest.mark.parametrize(
    "copy",
    [
        {"gen/a_msgs/msg/__init__.py": "", "gen/a_msgs/msg/_point.py": "", "gen/a_msgs/msg/__pycache__/x.pyc": ""},
        {"install/include/a_msgs/a_msgs/msg/point.hpp": "", "lib/python3/site-packages/a_msgs/msg/_point.py": ""},
        {"venv/pyvenv.cfg": "", "venv/lib/site-packages/rosidl_py_gen/interfaces/a_msgs/msg/Point.msg": "int8 x"},
        {"out/CMakeCache.txt": "", "out/rosidl_adapter/a_msgs/msg/Point.idl": ""},
        {"web/action/__init__.py": "", "web/action/Handler.py": ""},
    ],
)
def test_copies_of_definitions_made_by_tools_are_not_packages(tmp_path: Path, copy: dict[str, str]) -> None:
    found = only(write(tmp_path, {**{f"src/{name}": text for name, text in POINT.items()}, **copy}))
    assert {name: one.folder for name, one in found.packages.items()} == {"a_msgs": tmp_path / "src" / "a_msgs"}


def test_virtual_environment_given_as_search_path_is_searched(tmp_path: Path) -> None:
    write(tmp_path, {"pyvenv.cfg": "", **POINT})
    assert set(packages(only(tmp_path))) == {"a_msgs"}


def test_package_name_is_read_from_the_manifest_not_from_the_folder(tmp_path: Path) -> None:
    manifest = (
        "<?xml version='1.0'?><!-- <name>wrong</name> --><package format='3'>\n<name> real_msgs </name></package>"
    )
    found = only(write(tmp_path, {"checkout/package.xml": manifest, "checkout/msg/Point.msg": "float64 x"}))
    assert set(packages(found)) == {"real_msgs"}


@pytest.mark.parametrize("mark", ["COLCON_IGNORE", "AMENT_IGNORE", "CATKIN_IGNORE"])
def test_interface_packages_in_ignored_folders_are_not_found(tmp_path: Path, mark: str) -> None:
    found = only(write(tmp_path, {**POINT, "old/b_msgs/msg/Point.msg": "float64 x", f"old/{mark}": ""}))
    assert set(packages(found)) == {"a_msgs"}


@pytest.mark.parametrize(
    ("files", "text"),
    [
        ({"readme.txt": ""}, "expected a package"),
        ({"2bad/msg/A.msg": ""}, '"2bad" is not a legal package name'),
        ({"pkg/package.xml": "<name>../../etc</name>", "pkg/msg/A.msg": ""}, '"../../etc" is not a legal package name'),
        ({"pkg/package.xml": "<name>/abs</name>", "pkg/msg/A.msg": ""}, '"/abs" is not a legal package name'),
        ({"pkg/package.xml": "<name>a__b</name>", "pkg/msg/A.msg": ""}, '"a__b" is not a legal package name'),
    ],
)
def test_folder_without_a_usable_package_is_refused(tmp_path: Path, files: dict[str, str], text: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        LoadedInterfaces.load(only(write(tmp_path, files)), [])
    assert text in str(caught.value)


def test_package_with_an_illegal_name_is_an_error_only_if_it_is_selected(tmp_path: Path) -> None:
    found = only(write(tmp_path, {**POINT, "2bad/msg/A.msg": ""}))
    assert [str(name) for name in LoadedInterfaces.load(found, ["a_msgs"])[1]] == ["a_msgs/msg/Point"]
    with pytest.raises(DefinitionError, match="is not a legal package name"):
        LoadedInterfaces.load(found, ["2bad"])


def test_two_packages_of_one_name_in_one_search_path_entry_are_refused(tmp_path: Path) -> None:
    write(tmp_path, {"one/a_msgs/msg/A.msg": "", "two/a_msgs/msg/A.msg": ""})
    with pytest.raises(DefinitionError, match='two packages are called "a_msgs"'):
        only(tmp_path)


def test_folder_given_twice_is_searched_once(tmp_path: Path) -> None:
    write(tmp_path, {"a_msgs/msg/Point.msg": "float64 x", "b_msgs/msg/Point.msg": "float64 x"})
    package = tmp_path / "a_msgs"
    (tmp_path / "link").symlink_to(package)
    for folders in ([package, package], [package, tmp_path], [package, tmp_path / "link"], [tmp_path, f"{tmp_path}/"]):
        found = SearchPath.scan(folders, ament="", bundled=False)
        assert found.packages["a_msgs"].folder.samefile(package) and found.hidden == [], folders


def test_search_for_packages_ends_in_loops_of_symbolic_links(tmp_path: Path) -> None:
    write(tmp_path, POINT)
    (tmp_path / "loop").symlink_to(tmp_path)
    (tmp_path / "link").symlink_to(tmp_path / "a_msgs")
    (tmp_path / "self").symlink_to(tmp_path / "self")
    (tmp_path / "a_msgs" / "again").symlink_to(tmp_path / "a_msgs")
    (tmp_path / "a_msgs" / "msg" / "Loop.msg").symlink_to(tmp_path / "a_msgs" / "msg" / "Loop.msg")
    (tmp_path / "a_msgs" / "msg" / "Gone.msg").symlink_to(tmp_path / "nowhere")
    found = only(tmp_path)
    assert [str(name) for name in found.packages["a_msgs"].files] == ["a_msgs/msg/Point"]


def test_interface_packages_in_very_deep_folders_are_not_found(tmp_path: Path) -> None:
    deep = tmp_path / "/".join("d" * 120) / "a_msgs" / "msg"
    deep.mkdir(parents=True)
    write(tmp_path, {"b_msgs/msg/A.msg": ""})
    assert set(packages(only(tmp_path))) == {"b_msgs"}


def test_files_of_other_kinds_are_not_interfaces(tmp_path: Path) -> None:
    files = {
        "a_msgs/msg/Point.msg": "",
        "a_msgs/msg/Point.idl": "",  # hidden by the .msg
        "a_msgs/msg/Other.idl": "",
        "a_msgs/msg/Ask.srv": "",
        "a_msgs/msg/notes.txt": "",
        "a_msgs/msg/__init__.py": "",
        "a_msgs/msg/Point.msg.orig": "",
        "a_msgs/srv/Ask.srv": "",
        "a_msgs/msg/folder.msg/x": "",
    }
    found = only(write(tmp_path, files)).packages["a_msgs"].files
    assert {str(name): path.name for name, path in found.items()} == {
        "a_msgs/msg/Other": "Other.idl",
        "a_msgs/msg/Point": "Point.msg",
        "a_msgs/srv/Ask": "Ask.srv",
    }


# --- order ------------------------------------------------------------------------------------------------------------


def test_search_order_is_paths_then_ament_then_bundled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, {"one/std_msgs/msg/A.msg": "", "two/std_msgs/msg/A.msg": "", "two/b_msgs/msg/A.msg": ""})
    for prefix in ("first", "second"):
        share = tmp_path / prefix / "share"
        write(share, {f"{name}/msg/A.msg": "" for name in ("std_msgs", "b_msgs", "c_msgs")})
        write(share, {"not_interfaces/package.xml": "<name>x</name>", "Not-A-Package/msg/A.msg": ""})
    prefixes = [str(tmp_path / prefix) for prefix in ("first", "second")]
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([*prefixes, "", "/does/not/exist"]))
    found = SearchPath.scan([tmp_path / "one", tmp_path / "two"])
    origins = packages(found)
    assert origins["std_msgs"] == str(tmp_path / "one")
    assert origins["b_msgs"] == str(tmp_path / "two")
    assert origins["c_msgs"] == str(tmp_path / "first")
    assert origins["sensor_msgs"] == "bundled"
    assert "not_interfaces" not in origins
    assert [one.origin for one in found.hidden if one.name == "std_msgs"] == [
        str(tmp_path / "two"),
        *prefixes,
        "bundled",
    ]


# --- selection --------------------------------------------------------------------------------------------------------

WORLD = {
    "a_msgs/msg/Point.msg": "float64 x",
    "a_msgs/msg/Line.msg": "Point[2] ends",
    "a_msgs/msg/Lone.msg": "uint8 x",
    "b_msgs/msg/Map.msg": "a_msgs/Line[] lines",
    "b_msgs/msg/Note.msg": "string text",
    "c_msgs/srv/Ask.srv": "b_msgs/Note note\n---",
    "d_msgs/action/Do.action": "---\n---",
}


def chosen(folder: Path, *wanted: str) -> set[str]:
    library = InterfaceRegistry(SearchPath.scan([write(folder, WORLD)], ament=""))
    return {str(name) for name in select(library, list(wanted))}


IMPLIED = ["action_msgs", "builtin_interfaces", "service_msgs", "unique_identifier_msgs"]


@pytest.mark.parametrize(
    ("wanted", "names"),
    [
        ("b_msgs", "a_msgs/msg/Point a_msgs/msg/Line a_msgs/msg/Lone b_msgs/msg/Map b_msgs/msg/Note"),
        ("b_msgs/msg/Map", "a_msgs/msg/Point a_msgs/msg/Line b_msgs/msg/Map"),
        ("a_msgs/Lone", "a_msgs/msg/Lone"),
        (
            "c_msgs/srv/Ask",
            "b_msgs/msg/Note builtin_interfaces/msg/Time c_msgs/srv/Ask service_msgs/msg/ServiceEventInfo",
        ),
    ],
)
def test_selection_of_interfaces_includes_their_dependencies(tmp_path: Path, wanted: str, names: str) -> None:
    assert chosen(tmp_path, wanted) == {*names.split()}


def test_packages_implied_by_actions_are_selected_and_no_filter_selects_all(tmp_path: Path) -> None:
    assert {name.split("/")[0] for name in chosen(tmp_path, "d_msgs")} == {"d_msgs", *IMPLIED}
    found = {name.split("/")[0] for name in chosen(tmp_path)}
    assert found >= {"a_msgs", "b_msgs", "c_msgs", "d_msgs", "std_msgs", "sensor_msgs"}


@pytest.mark.parametrize(
    ("wanted", "problem"),
    [
        ("b_msg", 'b_msg: no package; did you mean "b_msgs"? (searched: '),
        ("b_msgs/msg/Mapp", 'b_msgs/msg/Mapp: no interface of this name; did you mean "b_msgs/msg/Map"? (searched: '),
        ("nothing_like_it", "nothing_like_it: no package (searched: "),
        ("..", "..: no package (searched: "),
    ],
)
def test_unknown_package_or_interface_in_a_selection_is_refused(tmp_path: Path, wanted: str, problem: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        chosen(tmp_path, wanted)
    assert str(caught.value).startswith(problem)
    assert str(tmp_path) in str(caught.value)
    assert "bundled" in str(caught.value)


# --- references -------------------------------------------------------------------------------------------------------

BROKEN: list[tuple[dict[str, str | bytes], list[str]]] = [
    (
        {"a_msgs/msg/A.msg": "uint8 x\nstd_msgs/Heder header"},
        ['a_msgs/msg/A.msg:2:1: unknown type "std_msgs/Heder"; did you mean "std_msgs/Header"?'],
    ),
    (
        {"a_msgs/msg/A.msg": "Piont p", "a_msgs/msg/Point.msg": "uint8 x"},
        ['a_msgs/msg/A.msg:1:1: unknown type "a_msgs/Piont"; did you mean "a_msgs/Point"?'],
    ),
    (
        {"a_msgs/msg/A.msg": "sensor_msg/Image i"},
        [
            'a_msgs/msg/A.msg:1:1: unknown package "sensor_msg" for sensor_msg/Image; did you mean "sensor_msgs"? (searched: '
        ],
    ),
    ({"a_msgs/msg/A.msg": "A a"}, ["a_msgs/msg/A.msg:1:3: a_msgs/msg/A contains itself through this field"]),
    ({"a_msgs/msg/A.msg": "A[] a"}, ["a_msgs/msg/A.msg:1:5: a_msgs/msg/A contains itself through this field"]),
    (
        {"a_msgs/msg/A.msg": "B b", "a_msgs/msg/B.msg": "C c", "a_msgs/msg/C.msg": "A a"},
        ["a_msgs/msg/C.msg:1:3: a_msgs/msg/A contains itself through this field"],
    ),
    # A broken file is reported at its own location, not where other files use it.
    ({"a_msgs/msg/A.msg": "B b", "a_msgs/msg/B.msg": "int x"}, ['a_msgs/msg/B.msg:1:1: "int" is neither']),
    # Everything in one go, in file and line order.
    (
        {"a_msgs/msg/A.msg": "int x\nNo y", "a_msgs/srv/S.srv": "uint8 X\n---\nint8 y 200"},
        [
            'a_msgs/msg/A.msg:1:1: "int" is neither',
            'a_msgs/msg/A.msg:2:1: unknown type "a_msgs/No"',
            'a_msgs/srv/S.srv:1:7: "X" is not a field name',
            "a_msgs/srv/S.srv:3:8: expected an integer in -128..127",
        ],
    ),
    ({"a_msgs/srv/Two_Words.srv": "---"}, ['a_msgs/srv/Two_Words.srv:1:1: "Two_Words" is not an interface name']),
    ({"a_msgs/srv/Ask_Request.srv": "---"}, ['a_msgs/srv/Ask_Request.srv:1:1: "Ask_Request" is not an interface name']),
    ({"a_msgs/msg/bad_name.msg": "uint8 x"}, ['a_msgs/msg/bad_name.msg:1:1: "bad_name" is not an interface name']),
    ({"a_msgs/msg/A.msg": b"uint8 x\n# caf\xe9"}, ["a_msgs/msg/A.msg:2:6: expected UTF-8, found the byte 0xe9"]),
    ({"a_msgs/msg/A.msg": b"\xef\xbb\xbfuint8 x"}, ["a_msgs/msg/A.msg:1:1: found a byte order mark"]),
    ({"a_msgs/msg/A.msg": "uint8 x".encode("utf-16")}, ["a_msgs/msg/A.msg:1:1: expected UTF-8, found the byte 0xff"]),
    # Two files for one module, two classes of one name.
    (
        {"a_msgs/msg/UInt8.msg": "", "a_msgs/msg/Uint8.msg": "", "a_msgs/msg/UINT8.msg": ""},
        ["would both be the module a_msgs.msg._uint8"],
    ),
    ({"json/msg/A.msg": ""}, ['a package called "json" cannot be generated: Python needs that name itself']),
    ({"numpy/msg/A.msg": ""}, ['a package called "numpy" cannot be generated']),
    ({"rosidl_py_gen/msg/A.msg": ""}, ['a package called "rosidl_py_gen" cannot be generated']),
    ({"class/msg/A.msg": ""}, ['a package called "class" cannot be generated']),
]


@pytest.mark.parametrize(("files", "expected"), BROKEN, ids=range(len(BROKEN)))
def test_invalid_packages_are_reported_with_location_and_without_output(
    tmp_path: Path, files: dict[str, str | bytes], expected: list[str]
) -> None:
    found = problems_of(write(tmp_path / "in", files))
    assert len(found) == len(expected), found
    for problem, text in zip(found, expected, strict=True):
        assert text in problem
        assert problem.startswith(text) or not text.startswith("a_msgs/")


# --- packages that are missing ----------------------------------------------------------------------------------------


def test_errors_explain_why_a_package_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    manifest = "<package><name>{}</name></package>".format
    files = {
        "src/a_msgs/msg/A.msg": "x_msgs/Here a",
        "src/empty/package.xml": manifest("empty_msgs"),
        "src/old/COLCON_IGNORE": "",
        "src/old/deep/package.xml": manifest("old_msgs"),
        "src/old/deep/msg/A.msg": "",
        "src/catkin_msgs/CATKIN_IGNORE": "",
        "src/catkin_msgs/msg/A.msg": "",
        "prefix/share/plain_msgs/package.xml": manifest("plain_msgs"),
        "other/x/package.xml": manifest("x_msgs"),
        "other/x/msg/Here.msg": "",
        "generated/made_msgs/msg/__init__.py": f"{GeneratedCode.HEADER}. Do not edit.\n",
        "generated/made_msgs/__init__.py": f"{GeneratedCode.HEADER}. Do not edit.\n",
    }
    monkeypatch.chdir(write(tmp_path, files))
    monkeypatch.syspath_prepend(tmp_path / "generated")
    search = SearchPath.scan(["src"], ament="prefix", bundled=False)
    where = "(searched: src, prefix)"
    reasons = {
        "nowhere_msgs": f"no package {where}",
        "empty_msgs": f"no package with interfaces: src/empty has no .msg, .srv, .action or .idl file {where}",
        "plain_msgs": f"no package with interfaces: prefix/share/plain_msgs has no .msg, .srv, .action or .idl file {where}",
        "old_msgs": f"no package: src/old/deep is ignored because of src/old/COLCON_IGNORE; remove that file {where}",
        "catkin_msgs": f"no package: src/catkin_msgs is ignored because of src/catkin_msgs/CATKIN_IGNORE; remove that file {where}",
        "x_msgs": f"no package on the search path, but other/x has it; use --path . {where}",
        "made_msgs": f"no package with definitions: generated/made_msgs has generated classes only {where}",
        "a_msg": f'no package; did you mean "a_msgs"? {where}',
    }
    for package, reason in reasons.items():
        with pytest.raises(DefinitionError) as caught:
            LoadedInterfaces.load(search, [package])
        assert str(caught.value) == f"{package}: {reason}"
        with pytest.raises(TypeNotFoundError) as missing:
            InterfaceRegistry(search).read_checked(RosName(package, "msg", "A"))
        subject = f'no package "{package}" for {package}/msg/A'
        if package == "made_msgs":
            reason = f"no package: the importable package generated/made_msgs has no made_msgs/msg/A; generate it again {where}"
        assert str(missing.value) == reason.replace("no package", subject, 1)
    assert problems_of(Path("src")) == [
        'a_msgs/msg/A.msg:1:1: unknown package "x_msgs" for x_msgs/Here on the search path, but other/x has it; '
        "use --path . (searched: src, bundled)"
    ]


def test_search_for_the_reason_of_a_missing_package_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(60):
        (tmp_path / f"d{number}" / "e" / "f").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rosidl_py_gen.compiler.frontend.search_path.MAX_FOLDERS", 20)
    visited: list[str] = []
    scan = os.scandir
    monkeypatch.setattr(os, "scandir", lambda place: visited.append(str(place)) or scan(place))
    with pytest.raises(DefinitionError, match="no package"):
        LoadedInterfaces.load(SearchPath({}), ["x_msgs"])
    assert len(visited) < 100


def test_errors_suggest_ros_2_spelling_for_names_of_ros_1_and_other_languages(tmp_path: Path) -> None:
    lines = {
        "Header header": 'unknown type "a_msgs/Header"; use std_msgs/Header',
        "Time t": 'unknown type "a_msgs/Time"; use builtin_interfaces/Time',
        "Pose p": 'unknown type "a_msgs/Pose"; use geometry_msgs/Pose',
        "String s": 'unknown type "a_msgs/String"; use string or std_msgs/String',
        "Float64[] f": 'unknown type "a_msgs/Float64"; use float64 or std_msgs/Float64',
        "geometry_msgs/Header h": 'unknown type "geometry_msgs/Header"; use std_msgs/Header',
        "float x": "use float32 or float64",
        "double x": "use float64",
        "octet x": "use byte",
        "std_msgs/msg/Header h": '"std_msgs/msg/Header" is not a type in a .msg, .srv or .action file; write "std_msgs/Header", without "msg/"',
        "std_srvs/srv/Empty e": "only messages are types of fields",
        "Sampel s": 'unknown type "a_msgs/Sampel"',  # and not the file itself
        "uint8\u200b x": 'S.msg:1:1: "uint8<U+200B>" is neither',
        "uint8\u00a0x": "found \"<U+00A0>\"",
        "uint8\u2800 x": 'S.msg:1:1: "uint8<U+2800>" is neither',
    }  # fmt: skip
    for number, (line, expected) in enumerate(lines.items()):
        folder = write(tmp_path / str(number) / "a_msgs", {"msg/Sample.msg": line})
        (problem,) = problems_of(folder.parent)
        assert expected.replace("S.msg", "Sample.msg") in problem, line
        assert "a_msgs/Sample" not in problem.partition(": ")[2], line
    error = Diagnostic("a.msg", 1, 8, "wrong", "uint8\u200b x\u200b y").with_caret()
    assert error.splitlines()[1:] == ["    uint8<U+200B> x<U+200B> y", "    " + " " * 14 + "^"]


def test_a_missing_package_is_reported_once_for_each_file_and_explained_once(tmp_path: Path) -> None:
    files = {"one/msg/A.msg": "nav2x/B b\nnav2x/C c\nother/D d", "one/msg/B.msg": "nav2x/B b\nA a"}
    assert [one.partition(" (searched")[::2] for one in problems_of(write(tmp_path / "in", files))] == [
        ('one/msg/A.msg:1:1: unknown package "nav2x" for nav2x/B', f": {tmp_path / 'in'}, bundled)"),
        ('one/msg/A.msg:3:1: unknown package "other" for other/D', f": {tmp_path / 'in'}, bundled)"),
        ('one/msg/B.msg:1:1: unknown package "nav2x" for nav2x/B', ""),
    ]


def test_an_unreadable_folder_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    search = SearchPath.scan([write(tmp_path, {"a_msgs/msg/A.msg": "int32 x"})], ament="", bundled=False)
    real = os.scandir

    def refuse(folder: Path) -> object:
        if str(folder).endswith("a_msgs/msg"):
            raise PermissionError(13, "Permission denied", str(folder))
        return real(folder)

    monkeypatch.setattr(os, "scandir", refuse)  # root, which runs CI, has all permissions
    with pytest.raises(DefinitionError, match="a_msgs/msg: the folder cannot be read: Permission denied"):
        _ = search.packages["a_msgs"].files


def test_index_of_ros_packages_that_cannot_be_reached_is_not_searched(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = SearchPath.scan().packages.keys()
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.setattr(InstalledInterfaces, "ros_index", lambda: str(tmp_path / "loop" / "index"))
    assert SearchPath.scan().packages.keys() == expected
