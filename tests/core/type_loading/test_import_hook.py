"""The import hook: packages of definitions, installed packages, settings and the cache."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from support.interface_packages import write
from support.rclpy_messages import hooked

from rosidl_py_gen import DefinitionError, ImportHookWarning, RosidlError, get_message, install_import_hook
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import generate
from rosidl_py_gen.type_loading import disk_cache
from rosidl_py_gen.type_loading.disk_cache import VARIABLE

PACKAGE_XML = "<package><name>{}</name></package>"
APIS = pytest.mark.parametrize("message_api", ["native", "rclpy"])


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "cache"))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    # Other tests of this process generate packages.
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if not Path(entry, "std_msgs").is_dir()])
    return tmp_path / "cache" / "modules"


@pytest.fixture
def definitions(tmp_path: Path) -> Path:
    files = {
        "hooked_msgs/msg/Point.msg": "float64 x\nuint8 LIMIT = 7",
        "hooked_msgs/msg/Path.msg": "std_msgs/Header header\nPoint[] points\nbyte flag 3",
        "hooked_msgs/srv/AddTwo.srv": "int32 a\n---\nint32 sum",
        "hooked_msgs/action/Go.action": "int32 a\n---\nint32 b\n---\nint32 c",
    }
    return write(tmp_path / "definitions", files)


def python(program: str, *arguments: str | Path, **settings: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", textwrap.dedent(program), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env={**os.environ, **settings}, timeout=120)


# --- its packages -----------------------------------------------------------------------------------------------------


@APIS
def test_definition_that_was_removed_after_the_import_is_an_error(message_api: Any, definitions: Path) -> None:
    with hooked(message_api=message_api, path=definitions):
        messages = import_module("hooked_msgs.msg")
        (definitions / "hooked_msgs/msg/Point.msg").unlink()
        with pytest.raises(RosidlError, match="hooked_msgs/msg/Point"):
            _ = messages.Point


@APIS
def test_packages_of_definitions_have_modules_and_classes_of_all_kinds(message_api: Any, definitions: Path) -> None:
    with hooked(message_api=message_api, path=definitions):
        msg, srv, action = (import_module(f"hooked_msgs.{kind}") for kind in ("msg", "srv", "action"))
        assert [name for name in dir(msg) if name[0].isupper()] == ["Path", "Point"] == msg.__all__
        assert {"AddTwo", "AddTwo_Request", "AddTwo_Event"} <= set(dir(srv))
        assert {"Go", "Go_Goal", "Go_SendGoal_Request", "Go_FeedbackMessage"} <= set(dir(action))
        made = msg.Path(points=[msg.Point(x=1.5)])
        assert msg.Path.decode(made.encode()).points[0].x == 1.5
        assert made.flag == (b"\3" if message_api == "rclpy" else 3) and msg.Point.LIMIT == 7
        assert srv.AddTwo.Request is srv.AddTwo_Request is import_module("hooked_msgs.srv._add_two").AddTwo_Request
        assert action.Go.Result is action.Go_Result and action.Go.SendGoal is action.Go_SendGoal
        assert type(made.header) is import_module("std_msgs.msg").Header
        for name in srv.__all__ + action.__all__:
            assert isinstance(getattr(srv if hasattr(srv, name) else action, name), type)
        with pytest.raises(ImportError, match="Nothing"):
            exec("from hooked_msgs.msg import Nothing")
        with pytest.raises(ModuleNotFoundError):
            import_module("hooked_msgs.msg._nothing")
        with pytest.raises(ModuleNotFoundError):
            import_module("nothing_msgs.msg")
    assert "hooked_msgs" not in sys.modules


@pytest.mark.slow
def test_native_classes_are_those_of_everybody(definitions: Path) -> None:
    with hooked(path=definitions):
        assert import_module("hooked_msgs.msg").Path is get_message("hooked_msgs/msg/Path", path=definitions)


def test_definitions_in_ament_prefix_path_can_be_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "prefix", {"share/ament_hooked_msgs/msg/A.msg": "int32 a"})
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    with hooked(message_api="rclpy"):
        assert import_module("ament_hooked_msgs.msg").A(a=5).a == 5


def test_workspace_without_message_packages_is_not_an_error(tmp_path: Path) -> None:
    write(tmp_path, {"src/only_nodes/package.xml": PACKAGE_XML.format("only_nodes"), "src/only_nodes/a.py": ""})
    for around in (tmp_path, tmp_path / "src" / "only_nodes" / "a.py"):
        with hooked(message_api="rclpy", workspace_of=around):
            assert import_module("std_msgs.msg").String(data="a").data == "a"


@pytest.mark.parametrize("built", [False, True], ids=["in the workspace", "on the path"])
def test_package_with_python_modules_and_messages_stays_one_package(
    tmp_path: Path, built: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = {
        "src/both_kinds/package.xml": PACKAGE_XML.format("both_kinds"),
        "src/both_kinds/msg/A.msg": "int32 a",
        "src/both_kinds/both_kinds/__init__.py": "value = 1",
        "src/both_kinds/both_kinds/tool.py": "from both_kinds.msg import A\nmade = A(a=3)",
    }
    write(tmp_path, files)
    if built:
        monkeypatch.syspath_prepend(str(tmp_path / "src" / "both_kinds"))
    try:
        with hooked(message_api="rclpy", workspace_of=tmp_path / "src" / "both_kinds"):
            assert import_module("both_kinds.tool").made.a == 3
            package = import_module("both_kinds")
            assert package.value == 1 and [*package.__path__] == [str(tmp_path / "src/both_kinds/both_kinds")]
            assert import_module("both_kinds.msg").A is import_module("both_kinds.tool").A
        assert "both_kinds.msg" not in sys.modules
    finally:
        for name in [name for name in sys.modules if name.startswith("both_kinds")]:
            del sys.modules[name]


def test_namespace_package_of_a_definition_folder_does_not_hide_messages(
    definitions: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From the folder of definitions, Python finds namespace packages of these names."""
    monkeypatch.syspath_prepend(str(definitions))
    with hooked(message_api="rclpy", path=definitions):
        assert import_module("hooked_msgs.msg").Point(x=1).x == 1


# --- untouched packages -----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_without_it_nothing_changes(definitions: Path) -> None:
    program = """
        import sys
        before = [*sys.meta_path]
        import rosidl_py_gen, rosidl_py_gen.type_loading.import_hook, rosidl_py_gen.type_loading.interface_modules
        rosidl_py_gen.install_import_hook
        assert sys.meta_path == before
        try:
            import std_msgs.msg
        except ModuleNotFoundError:
            print("not there")
    """
    done = python(program)
    assert done.stdout == "not there\n", done.stderr


REAL = {
    "real/std_msgs/__init__.py": "",
    "real/std_msgs/msg/__init__.py": "class Header: pass\nclass String: real = True",
    "real/std_msgs/msg/_header.py": "from std_msgs.msg import Header",
}


def test_installed_packages_are_preferred_with_a_warning(
    tmp_path: Path, definitions: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, REAL)
    monkeypatch.syspath_prepend(str(tmp_path / "real"))
    with hooked(warns=True, message_api="rclpy", path=definitions):
        with pytest.warns(ImportHookWarning, match=r"std_msgs.msg: using .*real.std_msgs.msg.__init__.py, not the def"):
            assert import_module("std_msgs.msg").String.real
        with pytest.raises(ImportError, match=r"hooked_msgs/msg/Path needs std_msgs, and .*override_installed=True"):
            import_module("hooked_msgs.msg._path")
        assert import_module("hooked_msgs.msg").Point(x=1).x == 1


def test_installed_packages_are_overridden_on_request_with_a_warning(
    tmp_path: Path, definitions: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, REAL)
    monkeypatch.syspath_prepend(str(tmp_path / "real"))
    with hooked(warns=True, message_api="rclpy", path=definitions, override_installed=True):
        with pytest.warns(ImportHookWarning, match=r"std_msgs.msg: using the definitions in .*std_msgs, not .*real"):
            assert not hasattr(import_module("std_msgs.msg").String, "real")
        assert import_module("hooked_msgs.msg").Path().header.frame_id == ""


@APIS
def test_packages_that_were_generated_are_used_with_a_warning_for_another_api(
    message_api: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Generated packages equal those of the hook, except for the API."""
    write(tmp_path, {"defs/made_msgs/msg/A.msg": "int32 a"})
    generate(SearchPath.scan([tmp_path / "defs"], ament=""), ["made_msgs"], tmp_path / "out")
    monkeypatch.syspath_prepend(str(tmp_path / "out"))
    with (
        hooked(warns=True, message_api=message_api, path=tmp_path / "defs"),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        cls = import_module("made_msgs.msg").A
        assert cls.__module__ == "made_msgs.msg._a" and cls(a=1) == cls(1)
    assert [one.category for one in caught] == ([ImportHookWarning] if message_api == "rclpy" else [])


# --- settings and mistakes --------------------------------------------------------------------------------------------


def test_import_hook_is_installed_once_and_refuses_other_settings(definitions: Path) -> None:
    before = [*sys.meta_path]
    first = install_import_hook(message_api="rclpy", path=definitions)
    again = install_import_hook(message_api="rclpy", path=str(definitions))
    assert len(sys.meta_path) == len(before) + 2  # one at the front, and one for packages that no other finder has
    with pytest.raises(RuntimeError, match="other settings"):
        install_import_hook()
    first.close()
    first.close()
    again.close()
    assert sys.meta_path == before


def test_invalid_hook_settings_are_refused_and_no_hook_is_installed(tmp_path: Path) -> None:
    before = [*sys.meta_path]
    with pytest.raises(ValueError, match="message_api"):
        install_import_hook(message_api="rcl")  # type: ignore[arg-type]
    with pytest.raises(DefinitionError, match="expected a folder"):
        install_import_hook(path=tmp_path / "nothing")
    wrong: Any
    for wrong, text in (
        ({"workspace_of": 5}, "workspace_of: expected a path, found 5"),
        (
            {"workspace_of": tmp_path / "nothing.py"},
            "workspace_of: expected a script or a folder, found '.*nothing.py'",
        ),
        ({"path": 5}, "path: expected a folder or several, found 5"),
        ({"path": [tmp_path, None]}, "path: expected a path, found None"),
    ):
        with pytest.raises(DefinitionError, match=text):
            install_import_hook(**wrong)
    assert sys.meta_path == before
    install_import_hook().close()


@APIS
def test_invalid_definition_is_an_error_when_its_class_is_imported(message_api: Any, tmp_path: Path) -> None:
    write(tmp_path, {"odd_hooked_msgs/msg/Bad.msg": "int33 a", "odd_hooked_msgs/msg/Good.msg": "int32 a"})
    with hooked(message_api=message_api, path=tmp_path):
        module = import_module("odd_hooked_msgs.msg")
        for _ in range(2):
            with pytest.raises(DefinitionError, match=r"Bad.msg:1:1"):
                _ = module.Bad
        assert module.Good(a=1).a == 1


def test_two_interfaces_of_one_module_are_refused(tmp_path: Path) -> None:
    write(tmp_path, {"twin_msgs/msg/FooBar.msg": "int32 a", "twin_msgs/msg/FOOBar.msg": "int32 a"})
    with hooked(message_api="rclpy", path=tmp_path), pytest.raises(ImportError, match="would both be the module"):
        import_module("twin_msgs.msg._foo_bar")


def test_rosidl_parser_definition_is_provided_if_it_is_not_installed() -> None:
    with hooked(message_api="rclpy"):
        definition = import_module("rosidl_parser.definition")
        assert import_module("std_msgs.msg").Header.SLOT_TYPES[1] == definition.UnboundedString()


# --- the cache --------------------------------------------------------------------------------------------------------


def made(definitions: Path) -> bool:
    """Return True if the import of a message compiled it; False if it came from the cache."""
    calls: list[object] = []
    keep = disk_cache.store_code
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(disk_cache, "store_code", lambda *arguments: (calls.append(arguments), keep(*arguments)))
        with hooked(message_api="rclpy", path=definitions):
            point = import_module("hooked_msgs.msg").Point
            assert point.decode(point(x=1.5).encode()).x == 1.5
    return bool(calls)


needs_owners = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="nothing is kept where files have no owner")


@needs_owners
def test_compiled_modules_are_cached_in_private_files(definitions: Path, cache: Path) -> None:
    assert made(definitions) and not made(definitions)
    assert {path.stat().st_mode & 0o777 for path in cache.iterdir()} == {0o600}
    assert cache.stat().st_mode & 0o777 == 0o700


@needs_owners
def test_changed_definition_is_compiled_again(definitions: Path) -> None:
    assert made(definitions)
    (definitions / "hooked_msgs/msg/Point.msg").write_text("float64 x\nint32 more")
    assert made(definitions)
    with hooked(message_api="rclpy", path=definitions):
        assert import_module("hooked_msgs.msg").Point(more=1).more == 1
        assert import_module("hooked_msgs.msg").Path(points=[import_module("hooked_msgs.msg").Point(more=2)])
    (definitions / "hooked_msgs/msg/Point.msg").write_text("float64 x\nint32 more\nint32 most")
    with hooked(message_api="rclpy", path=definitions):  # a changed nested definition counts as well
        msg = import_module("hooked_msgs.msg")
        assert msg.Path.decode(msg.Path(points=[msg.Point(most=2)]).encode()).points[0].most == 2


@needs_owners
@pytest.mark.parametrize(
    "harm", ["folder for all", "file for all", "link", "folder is a link", "cut", "changed", "empty"]
)
def test_damaged_cache_or_cache_writable_by_others_is_not_used(
    definitions: Path, cache: Path, tmp_path: Path, harm: str
) -> None:
    assert made(definitions)
    for path in list(cache.iterdir()):
        data = path.read_bytes()
        if harm == "file for all":
            path.chmod(0o666)
        elif harm == "link":
            path.rename(tmp_path / path.name)
            path.symlink_to(tmp_path / path.name)
        elif harm in ("cut", "empty"):
            path.write_bytes(data[: len(data) // 2 if harm == "cut" else 0])
        elif harm == "changed":
            path.write_bytes(data[:-9] + bytes([data[-9] ^ 1]) + data[-8:])
    if harm == "folder for all":
        cache.chmod(0o777)
    elif harm == "folder is a link":
        cache.rename(tmp_path / "elsewhere")
        cache.symlink_to(tmp_path / "elsewhere")
    assert made(definitions)


@pytest.mark.parametrize("setting", ["other owner", "off"])
def test_untrusted_and_disabled_caches_are_not_used(
    definitions: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, setting: str
) -> None:
    if setting == "off":
        monkeypatch.setenv(VARIABLE, "off")
    elif not hasattr(os, "geteuid"):
        pytest.skip("files have no owner")
    else:
        assert made(definitions)
        monkeypatch.setattr(os, "geteuid", lambda: cache.stat().st_uid + 1)
    assert made(definitions) and made(definitions)
    assert cache.exists() is (setting != "off")


@pytest.mark.slow
@needs_owners
def test_a_second_start_needs_no_compiler(definitions: Path) -> None:
    program = """
        import sys
        from rosidl_py_gen import install_import_hook
        install_import_hook(message_api="rclpy", path=sys.argv[1])
        from hooked_msgs.msg import Path
        from hooked_msgs.action import Go
        print([name for name in ("jinja2", "rosidl_py_gen.compiler.codegen.module_sources") if name in sys.modules])
    """
    loaded = "['jinja2', 'rosidl_py_gen.compiler.codegen.module_sources']\n"
    assert [python(program, definitions).stdout for _ in range(2)] == [loaded, "[]\n"]
