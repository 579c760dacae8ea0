"""The wheel holds every template compiled, and prints the same with these alone as a checkout does from the texts.

It holds the bundled interfaces generated, too, which `get_message` and its like take where nothing else is meant.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from jinja2 import ModuleLoader
from support.folders import ROOT

TOP = ROOT


def run(top: Path, *words: str) -> None:
    """Run a module in a folder, whose packages it finds first."""
    done = subprocess.run([sys.executable, "-m", *words], cwd=top, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the package inside an unpacked wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    run(TOP, "hatchling", "build", "-t", "wheel", "-d", str(folder))
    (wheel,) = folder.glob("*.whl")
    with ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder / "rosidl_py_gen"


def test_wheel_contains_compiled_module_of_each_template_and_checkout_none(package: Path) -> None:
    templates = TOP / "templates"
    texts = [path.relative_to(templates).as_posix() for path in templates.rglob("*.jinja")]
    compiled = sorted(path.name for path in (package / "compiled_templates").iterdir() if path.is_file())
    assert compiled == sorted(map(ModuleLoader.get_module_filename, texts))
    assert len(compiled) > 5
    assert not (TOP / "rosidl_py_gen" / "compiled_templates").exists()


def test_compiled_templates_generate_same_code_as_template_texts(package: Path, tmp_path: Path) -> None:
    for path in (package / "templates").rglob("*.jinja"):
        path.unlink()  # so that only the compiled ones are left
    printed = {}
    for name, top in (("wheel", package.parent), ("checkout", TOP)):
        out = tmp_path / name
        run(top, "rosidl_py_gen.generator_cli", "--out", str(out))
        printed[name] = {path.relative_to(out): path.read_bytes() for path in out.rglob("*.py")}
    assert printed["wheel"] == printed["checkout"]
    assert len(printed["wheel"]) > 200


def found(package: Path, program: str, **environment: str) -> list[str]:
    """Return the words printed by a program that imports the package of the wheel."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=package.parent,
        env={**os.environ, "AMENT_PREFIX_PATH": "", "PYTHONPATH": "", **environment},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


POSE = "geometry_msgs/msg/PoseStamped"
READY = "rosidl_py_gen.pregenerated"


def test_wheel_contains_all_bundled_interfaces_pregenerated_and_checkout_none(package: Path, tmp_path: Path) -> None:
    run(TOP, "rosidl_py_gen.generator_cli", "--out", str(tmp_path))
    printed = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.py")}
    ready = {path.relative_to(package / "pregenerated").as_posix() for path in (package / "pregenerated").rglob("*.py")}
    assert ready == {*printed, "__init__.py"}
    assert not (TOP / "rosidl_py_gen" / "pregenerated").exists()


def test_bundled_types_use_pregenerated_classes_without_loading_compiler(package: Path) -> None:
    program = """
import sys
from rosidl_py_gen import get_action, get_message, get_service
from rosidl_py_gen.base.resources import DataFolders
get = {"msg": get_message, "srv": get_service, "action": get_action}
for file in DataFolders.interfaces().glob("*/*/*.*"):
    if file.parent.name in get:
        name = f"{file.parent.parent.name}/{file.parent.name}/{file.stem}"
        cls = get[file.parent.name](name)
        assert cls._TYPE.name == name, name
        print(cls.__module__.rpartition(".")[0])
assert "jinja2" not in sys.modules and "rosidl_py_gen.compiler.frontend" not in sys.modules
"""
    modules = found(package, program)
    assert len(modules) > 200
    assert f"{READY}.geometry_msgs.msg" in modules
    assert all(name.startswith((READY, "rosidl_py_gen.msgs.")) for name in modules)


def test_pregenerated_classes_have_same_hash_and_description_as_compiled_ones(package: Path) -> None:
    program = f"""
from rosidl_py_gen import get_message, type_description, type_hash
cls = get_message("{POSE}")
print(cls.__module__.split(".")[0], type_hash(cls))
print(repr(type_description(cls)).replace(" ", ""))
"""
    ready = found(package, program)
    assert found(package, f"import os; os.environ['AMENT_PREFIX_PATH'] = '/nowhere'\n{program}") == [
        "rosidl_py_gen_memory",
        *ready[1:],
    ]


def test_definition_before_bundled_one_on_search_path_is_used(package: Path, tmp_path: Path) -> None:
    folder = tmp_path / "share" / "std_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Header.msg").write_text("string other\n")
    program = f'from rosidl_py_gen import get_message\nprint(*get_message("{POSE}").__slots__)\n'
    program += f'print(*get_message("{POSE}")().header.__slots__)'
    assert found(package, program, AMENT_PREFIX_PATH=str(tmp_path)) == ["header", "pose", "other"]
    program = program.replace(f'"{POSE}"', f'"{POSE}", path={str(tmp_path / "share")!r}')
    assert found(package, program) == ["header", "pose", "other"]


def test_nested_type_generated_by_user_is_used_in_bundled_type(package: Path, tmp_path: Path) -> None:
    run(TOP, "rosidl_py_gen.generator_cli", "--out", str(tmp_path), "--filter", "std_msgs")
    program = f"""
from rosidl_py_gen import get_message
from std_msgs.msg import Header
pose = get_message("{POSE}")
assert type(pose().header) is Header
print(pose.__module__.split(".")[0], get_message("std_msgs/msg/Header").__module__)
"""
    words = found(package, program, PYTHONPATH=str(tmp_path))
    assert words == ["rosidl_py_gen_memory", "std_msgs.msg._header"]


def test_type_has_one_class_regardless_of_text_or_wheel_loaded_first(package: Path) -> None:
    header = "builtin_interfaces/Time stamp\\nstring frame_id\\n"
    text_first = f"""
from rosidl_py_gen import compile_definition, get_message
header = compile_definition("std_msgs/msg/Header", "{header}")
pose = get_message("{POSE}")
assert type(pose().header) is header is get_message("std_msgs/msg/Header")
print(pose.__module__.split(".")[0])
"""
    wheel_first = f"""
from rosidl_py_gen import compile_definition, get_message
pose = get_message("{POSE}")
header = compile_definition("std_msgs/msg/Header", "{header}")
assert type(pose().header) is header is get_message("std_msgs/msg/Header")
print(header.__module__)
"""
    assert found(package, text_first) == ["rosidl_py_gen_memory"]
    assert found(package, wheel_first) == [f"{READY}.std_msgs.msg._header"]
