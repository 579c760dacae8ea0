"""rclpy and its companions by the import hook; a warning names a package that is not used."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pytest
from support.interface_packages import write

from rosidl_py_gen import ImportHookWarning, found_packages, install_import_hook
from rosidl_py_gen.type_loading.import_hook import RCLPY_COMPAT_DIR

NAME = "ament_index_python"
PACKAGE_XML = "<package><name>{}</name></package>"


@pytest.fixture(autouse=True)
def _modules(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.split(".")[0] == NAME]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if not entry.endswith("rosidl_py_gen/ros_compat")])
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", "off")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


@pytest.fixture
def real(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a real package importable, and return its folder."""
    write(tmp_path, {f"{NAME}/__init__.py": "", f"{NAME}/packages.py": "REAL = True"})
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def test_compat_packages_can_be_imported_only_while_the_hook_is_installed() -> None:
    with install_import_hook(message_api="rclpy"):
        assert Path(str(import_module(f"{NAME}.packages").__file__)).is_relative_to(RCLPY_COMPAT_DIR)
    assert not [name for name in sys.modules if name.split(".")[0] == NAME]
    with pytest.raises(ModuleNotFoundError):
        import_module(NAME)


def test_hook_with_native_messages_provides_no_compat_packages() -> None:
    with install_import_hook(), pytest.raises(ModuleNotFoundError):
        import_module(NAME)


@pytest.mark.parametrize("override", [False, True])
def test_real_or_compat_package_is_used_with_a_warning_about_the_other(real: Path, override: bool) -> None:
    used, unused = (RCLPY_COMPAT_DIR, real) if override else (real, RCLPY_COMPAT_DIR)
    with install_import_hook(message_api="rclpy", override_installed=override):
        with pytest.warns(ImportHookWarning, match=f"{NAME}: using {used}.*, not {unused}"):
            found = import_module(f"{NAME}.packages")
        assert Path(str(found.__file__)).is_relative_to(used)
    assert (sys.modules.get(f"{NAME}.packages") is found) is not override
    for name in (f"{NAME}.packages", NAME):
        sys.modules.pop(name, None)


def test_every_compat_package_can_be_imported() -> None:
    names = [path.name for path in RCLPY_COMPAT_DIR.iterdir() if (path / "__init__.py").is_file()]
    assert NAME in names and "rclpy" in names
    before = set(sys.modules)
    with install_import_hook(message_api="rclpy", override_installed=True):
        for name in names:
            assert import_module(name).__spec__.origin == str(RCLPY_COMPAT_DIR / name / "__init__.py")  # type: ignore[union-attr]
    assert not [name for name in set(sys.modules) - before if name.split(".")[0] in names]


def test_packages_next_to_a_package_outside_of_src_are_found(tmp_path: Path) -> None:
    files = {
        "clone/one/package.xml": PACKAGE_XML.format("one_package"),
        "clone/one/one_package/__init__.py": "from two_package import TWO",
        "clone/a_copy/package.xml": PACKAGE_XML.format("one_package"),
        "clone/a_copy/one_package/__init__.py": "raise AssertionError",
        "clone/two/package.xml": PACKAGE_XML.format("two_package"),
        "clone/two/src/two_package/__init__.py": "TWO = 2",
        "clone/three/package.xml": PACKAGE_XML.format("three_msgs"),
        "clone/three/msg/A.msg": "int32 a",
        "clone/group/deep/package.xml": PACKAGE_XML.format("deep_package"),
        "clone/group/deep/deep_package/__init__.py": "",
    }
    write(tmp_path, files)
    script, path = tmp_path / "clone/one/one_package/__init__.py", tmp_path / "clone/three"
    with install_import_hook(
        message_api="rclpy", workspace_of=script, path=[path]
    ):  # the workspace contains this package as well
        assert import_module("one_package").TWO == 2
        assert import_module("three_msgs.msg").A(a=1).a == 1
        with pytest.raises(ModuleNotFoundError):
            import_module("deep_package")


def test_packages_of_the_workspace_can_be_imported_and_are_listed(tmp_path: Path) -> None:
    files = {
        "src/one/package.xml": PACKAGE_XML.format("one_package"),
        "src/one/one_package/__init__.py": "from two_package import TWO",
        "src/one/other_name/__init__.py": "",
        "src/two/package.xml": PACKAGE_XML.format("two_package"),
        "src/two/two_package/__init__.py": "TWO = 2",
        "src/three/package.xml": PACKAGE_XML.format("three_msgs"),
        "src/three/msg/A.msg": "int32 a",
        "src/json/package.xml": PACKAGE_XML.format("json"),
        "src/json/json/__init__.py": "raise AssertionError",
        "src/empty/package.xml": PACKAGE_XML.format("empty_package"),
    }
    write(tmp_path, files)
    with install_import_hook(message_api="rclpy", workspace_of=tmp_path):
        assert import_module("one_package").TWO == 2
        for name in ("other_name", "empty_package"):
            with pytest.raises(ModuleNotFoundError):
                import_module(name)
        found = found_packages()
        assert {"one_package", "two_package", "three_msgs", "empty_package", "std_msgs"} <= found.keys()
        assert found["three_msgs"].interfaces == ("msg/A.msg",)
        assert (
            found["three_msgs"].folder == (tmp_path / "src/three").resolve() and found["one_package"].interfaces == ()
        )
    assert found_packages() == {}
    for name in ("one_package", "two_package"):
        sys.modules.pop(name)
