"""Cached searches of workspaces: changes are found, and unusable caches are ignored."""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from support.interface_packages import write

from rosidl_py_gen.base.distributions import Distribution
from rosidl_py_gen.compiler.frontend import search_path
from rosidl_py_gen.compiler.frontend.search_path import SearchPath, Workspace
from rosidl_py_gen.errors import DefinitionError
from rosidl_py_gen.type_loading import scan_cache
from rosidl_py_gen.type_loading.disk_cache import VARIABLE
from rosidl_py_gen.type_loading.scan_cache import search, workspace_packages

JAZZY = Distribution("jazzy", False)
XML = "<package><name>{}</name></package>"
FILES = {
    "ws/src/a_msgs/package.xml": XML.format("a_msgs"),
    "ws/src/a_msgs/msg/A.msg": "int32 x\n",
    "ws/src/robot/package.xml": XML.format("robot"),
    "ws/src/robot/robot/__init__.py": "",
    "ws/src/group/b_msgs/package.xml": XML.format("b_msgs"),
    "ws/src/group/b_msgs/msg/B.msg": "int32 x\n",
}


@pytest.fixture(autouse=True)
def _folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    monkeypatch.setattr(scan_cache, "MIN_AGE_NS", -(10**18))  # searches of files written just now are cached, too
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    write(tmp_path, FILES)
    yield


@pytest.fixture
def scans(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Record the searches that were not read from the cache."""
    made: list[object] = []
    original = SearchPath.scan

    def counted(*arguments: object, **settings: object) -> SearchPath:
        made.append(arguments)
        return original(*arguments, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr(SearchPath, "scan", counted)
    return made


def _workspace(tmp_path: Path) -> Workspace:
    return Workspace(tmp_path / "ws" / "src")


def _found(tmp_path: Path, path: tuple[str, ...] = (), choice: Distribution = JAZZY) -> dict[str, list[str]]:
    """Return the packages of the workspace and of `path`, with their files."""
    _, found = search(path, _workspace(tmp_path), choice)
    inside = {name: one for name, one in found.packages.items() if one.folder.is_relative_to(tmp_path)}
    return {name: sorted(path.name for path in one.files.values()) for name, one in inside.items()}


def test_second_search_is_read_from_the_cache(tmp_path: Path, scans: list[object]) -> None:
    first = _found(tmp_path)
    assert first == {"a_msgs": ["A.msg"], "b_msgs": ["B.msg"]} and len(scans) == 1
    folders, found = search((), _workspace(tmp_path), JAZZY)
    again, _ = search((), _workspace(tmp_path), JAZZY)
    assert _found(tmp_path) == first and len(scans) == 1 and folders == again == [str(tmp_path / "ws" / "src")]
    assert "std_msgs" in found.packages and found.packages["a_msgs"].from_source and "bundled" in found.searched


CHANGES = {
    "a file more": lambda src: (src / "a_msgs/msg/New.msg").write_text("bool b\n"),
    "a file less": lambda src: (src / "a_msgs/msg/A.msg").unlink(),
    "a file renamed": lambda src: (src / "a_msgs/msg/A.msg").rename(src / "a_msgs/msg/Z.msg"),
    "a package more": lambda src: write(src, {"c_msgs/package.xml": XML.format("c_msgs"), "c_msgs/srv/C.srv": "---\n"}),
    "a package deeper": lambda src: write(src, {"group/d/package.xml": XML.format("d"), "group/d/msg/D.msg": ""}),
    "another name": lambda src: (src / "a_msgs/package.xml").write_text(XML.format("other_msgs")),
    "no interfaces": lambda src: [(src / "a_msgs/msg/A.msg").unlink(), (src / "a_msgs/msg").rmdir()],
    "ignored": lambda src: (src / "group/COLCON_IGNORE").write_text(""),
    "a kind more": lambda src: write(src, {"robot/msg/R.msg": "int8 r\n"}),
    "a list of files": lambda src: write(
        src, {"a_msgs/CMakeLists.txt": 'rosidl_generate_interfaces(a_msgs "msg/Not.msg")\n', "a_msgs/msg/Not.msg": ""}
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_change_of_a_workspace_is_found_as_without_cache(
    change: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, packages_before = _found(tmp_path), workspace_packages(_workspace(tmp_path))
    CHANGES[change](tmp_path / "ws" / "src")
    found, packages = _found(tmp_path), workspace_packages(_workspace(tmp_path))
    with monkeypatch.context() as patch:
        patch.setenv(VARIABLE, "off")
        assert found == _found(tmp_path) and packages == _workspace(tmp_path).packages
    assert found != before or packages != packages_before


def test_changed_target_of_a_symbolic_link_is_found(tmp_path: Path) -> None:
    write(tmp_path, {"one/package.xml": XML.format("one_msgs"), "one/msg/One.msg": ""})
    write(tmp_path, {"two/package.xml": XML.format("two_msgs"), "two/msg/Two.msg": ""})
    link = tmp_path / "ws" / "src" / "link"
    link.symlink_to(tmp_path / "nowhere")
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs"}
    (tmp_path / "one").rename(tmp_path / "nowhere")
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs", "one_msgs"}
    link.unlink()
    link.symlink_to(tmp_path / "two")
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs", "two_msgs"}


def test_searches_with_different_settings_are_cached_separately(
    tmp_path: Path, scans: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, {"more/c_msgs/package.xml": XML.format("c_msgs"), "more/c_msgs/msg/C.msg": ""})
    write(tmp_path, {"prefix/share/d_msgs/package.xml": XML.format("d_msgs"), "prefix/share/d_msgs/msg/D.msg": ""})
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs"}
    assert set(_found(tmp_path, (str(tmp_path / "more"),))) == {"a_msgs", "b_msgs", "c_msgs"}
    for name in ("humble", "jazzy", "kilted"):
        _, found = search((), _workspace(tmp_path), Distribution(name, True))
        again = search((), _workspace(tmp_path), Distribution(name, True))[1]
        assert again.packages.keys() == found.packages.keys() and again.searched == found.searched
        assert {name: one.files for name, one in again.packages.items()} == {
            name: one.files for name, one in found.packages.items()
        }
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs", "d_msgs"}
    write(tmp_path, {"prefix/share/e_msgs/package.xml": XML.format("e_msgs"), "prefix/share/e_msgs/msg/E.msg": ""})
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs", "d_msgs", "e_msgs"}
    assert len(scans) == 7


def test_package_with_an_illegal_name_is_refused_by_cached_searches_too(tmp_path: Path, scans: list[object]) -> None:
    write(tmp_path, {"ws/src/Bad/package.xml": XML.format("Bad-Name"), "ws/src/Bad/msg/X.msg": ""})
    first, second = (search((), _workspace(tmp_path), JAZZY)[1].refused for _ in range(2))
    assert first == second and "Bad-Name" in first and len(scans) == 1


def test_search_error_is_not_cached(tmp_path: Path) -> None:
    write(tmp_path, {"ws/src/again/package.xml": XML.format("a_msgs"), "ws/src/again/msg/A.msg": ""})
    for _ in range(2):
        with pytest.raises(DefinitionError, match='two packages are called "a_msgs"'):
            _found(tmp_path)
    (tmp_path / "ws/src/again/COLCON_IGNORE").write_text("")
    assert set(_found(tmp_path)) == {"a_msgs", "b_msgs"}


def test_search_of_recently_changed_files_is_not_cached(
    tmp_path: Path, scans: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scan_cache, "MIN_AGE_NS", 2_000_000_000)
    _found(tmp_path)
    _found(tmp_path)
    assert len(scans) == 2
    monkeypatch.setattr(scan_cache, "time_ns", lambda: time.time_ns() + 10**10)
    _found(tmp_path)
    _found(tmp_path)
    assert len(scans) == 3


@pytest.mark.parametrize("damage", ["cut", "a folder"])
def test_a_damaged_cache_is_not_used(damage: str, tmp_path: Path, scans: list[object]) -> None:
    expected = _found(tmp_path)
    for file in (tmp_path / "cache" / "modules").glob("*.scan"):
        data = file.read_bytes()
        file.unlink()
        if damage == "a folder":
            file.mkdir()
        else:
            file.write_bytes(data[:-9])
    assert _found(tmp_path) == expected and len(scans) == 2


@pytest.mark.parametrize("place", ["file", "open for all", "off", "read-only"])
def test_unusable_cache_folder_is_ignored(
    place: str, tmp_path: Path, scans: list[object], monkeypatch: pytest.MonkeyPatch
) -> None:
    if place == "file":
        (tmp_path / "cache").write_text("")
    elif place in ("off", "read-only"):
        monkeypatch.setenv(VARIABLE, "off" if place == "off" else "/proc/nowhere")
    else:
        (tmp_path / "cache" / "modules").mkdir(parents=True)
        (tmp_path / "cache" / "modules").chmod(0o777)
    assert _found(tmp_path) == _found(tmp_path) == {"a_msgs": ["A.msg"], "b_msgs": ["B.msg"]} and len(scans) == 2
    assert not [*tmp_path.glob("cache/modules/*.scan")]


def test_concurrent_searches_may_write_the_cache(tmp_path: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        found = [*pool.map(lambda _: _found(tmp_path), range(24))]
    assert all(one == found[0] for one in found) and len([*(tmp_path / "cache" / "modules").glob("*.scan")]) == 1
    assert not [*(tmp_path / "cache" / "modules").glob("new-*")]


def test_cached_workspace_is_not_walked_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workspace_packages(_workspace(tmp_path))
    monkeypatch.setattr(search_path.ReadPaths, "note", lambda folder: pytest.fail("walked"))
    assert set(workspace_packages(_workspace(tmp_path))) == {"a_msgs", "b_msgs", "robot"}


def test_new_package_is_found_after_a_workspace_was_listed_twice_in_a_process(tmp_path: Path) -> None:
    workspace = _workspace(tmp_path)
    assert workspace.packages and set(workspace_packages(workspace)) == {"a_msgs", "b_msgs", "robot"}
    write(tmp_path, {"ws/src/new/package.xml": XML.format("new")})
    assert set(workspace_packages(_workspace(tmp_path))) == {"a_msgs", "b_msgs", "new", "robot"}


def test_new_sibling_of_a_package_outside_of_src_is_found_despite_the_cache(tmp_path: Path) -> None:
    write(tmp_path, {"all/own/package.xml": XML.format("own")})

    def found() -> list[str]:
        workspace = Workspace(tmp_path / "all", 1, tmp_path / "all" / "own")
        workspace_packages(workspace)
        _, result = search((), workspace, JAZZY)
        return [one.name for one in result.packages.values() if one.folder.is_relative_to(tmp_path)]

    assert found() == []
    write(tmp_path, {"all/c_msgs/package.xml": XML.format("c_msgs"), "all/c_msgs/msg/C.msg": "int32 x\n"})
    assert found() == ["c_msgs"]
