"""A workspace with every kind of install rule, and a listing of the prefix that is made of it.

`python tests/support/prefix_workspace.py BASE` records tests/golden/prefix_of_colcon.json: it builds the workspace with
colcon. BASE is a sourced prefix with ament_package, ament_cmake, ament_cmake_auto, ament_cmake_python, rosidl_cmake,
rosidl_adapter, rosidl_parser and ament_index_python, and packages service_msgs and action_msgs that are found.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from configparser import ConfigParser
from pathlib import Path
from typing import Any

RECORDED = Path(__file__).parents[1] / "golden" / "prefix_of_colcon.json"
_MANIFEST = """<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>1.2.3</version>
  <description>A package.</description>
  <maintainer email="a@b.org">A</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  {more}
  <export><build_type>{kind}</build_type></export>
</package>
"""
_PYTHON_SETUP = """
import os
from glob import glob
from setuptools import find_packages, setup

package_name = "py_plain"
setup(
    name=package_name,
    version="0.4.0",
    packages=find_packages(exclude=["test"]),
    py_modules=["py_plain_tools"],
    scripts=["scripts/py_script"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
        ("share/" + package_name, ["package.xml"]),
        (os.path.join("share", package_name), glob("launch/*.launch.py")),
        (os.path.join("share", package_name, "config"), [name for name in glob("config/*") if os.path.isfile(name)]),
        (f"share/{package_name}/config/deep", glob("config/deep/*")),
        ("share/ament_index/resource_index/py_plugins", ["resource/plugins/" + package_name]),
        ("lib/" + package_name, ["scripts/py_data_script", "scripts/py_helper.py"]),
    ],
    entry_points={
        "console_scripts": ["talk = py_plain.node:main", "py-listen=py_plain.node:Node.main"],
        "py_plain.plugins": ["one = py_plain.node:Node"],
    },
)
"""
_SOURCE_SETUP = """
from setuptools import find_packages, setup

setup(
    name="py_source",
    version="1.0.0",
    package_dir={"": "src"},
    packages=find_packages(where="src"),
    entry_points={"console_scripts": ["py_source_tool = py_source.tool:main"]},
)
"""
_CMAKE = """
cmake_minimum_required(VERSION 3.8)
project(cmake_all NONE)
find_package(ament_cmake REQUIRED)
find_package(ament_cmake_python REQUIRED)
set(CONFIGS config/a.yaml)
list(APPEND CONFIGS config/b.yaml)
file(GLOB WORLDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} worlds/*.world)
install(DIRECTORY launch DESTINATION share/${PROJECT_NAME})
install(DIRECTORY urdf/ DESTINATION share/${PROJECT_NAME}/robot PATTERN "*.tmp" EXCLUDE PATTERN "old" EXCLUDE)
install(DIRECTORY meshes DESTINATION share/${PROJECT_NAME} FILES_MATCHING PATTERN "*.stl")
install(FILES ${CONFIGS} DESTINATION share/${PROJECT_NAME}/config)
install(FILES config/a.yaml DESTINATION share/${PROJECT_NAME} RENAME renamed.yaml)
install(FILES ${WORLDS} DESTINATION share/${PROJECT_NAME}/worlds)
install(PROGRAMS scripts/node.py scripts/shell.sh DESTINATION lib/${PROJECT_NAME})
install(PROGRAMS scripts/node.py DESTINATION lib/${PROJECT_NAME} RENAME node_renamed)
install(FILES scripts/helper.py DESTINATION lib/${PROJECT_NAME})
ament_python_install_package(${PROJECT_NAME})
ament_python_install_package(cmake_other PACKAGE_DIR python/other)
ament_python_install_module(scripts/cmake_module.py)
ament_index_register_resource(cmake_texts CONTENT "some text")
ament_index_register_resource(cmake_files CONTENT_FILE resource/file.txt)
ament_package()
"""
_AUTO = """
cmake_minimum_required(VERSION 3.8)
project(cmake_auto NONE)
find_package(ament_cmake_auto REQUIRED)
ament_auto_package(INSTALL_TO_SHARE launch config)
"""
_MESSAGES = """
cmake_minimum_required(VERSION 3.8)
project(some_msgs NONE)
find_package(ament_cmake REQUIRED)
find_package(rosidl_cmake REQUIRED)
find_package(rosidl_adapter REQUIRED)
set(FILES msg/Plain.msg)
rosidl_generate_interfaces(${PROJECT_NAME} ${FILES} srv/Ask.srv action/Go.action)
ament_package()
"""
_MAIN = "class Node:\n    @staticmethod\n    def main():\n        print('listen')\n\n\ndef main():\n    print('talk')\n"
FILES = {
    "py_plain/package.xml": _MANIFEST.format(name="py_plain", kind="ament_python", more=""),
    "py_plain/setup.py": _PYTHON_SETUP,
    "py_plain/setup.cfg": "[develop]\nscript_dir=$base/lib/py_plain\n[install]\ninstall_scripts=$base/lib/py_plain\n",
    "py_plain/resource/py_plain": "",
    "py_plain/resource/plugins/py_plain": "share/py_plain/plugin.xml\n",
    "py_plain/py_plain/__init__.py": "",
    "py_plain/py_plain/node.py": _MAIN,
    "py_plain/test/__init__.py": "",
    "py_plain/py_plain_tools.py": "A = 1\n",
    "py_plain/scripts/py_script": "#!/usr/bin/env python3\nprint('script')\n",
    "py_plain/scripts/py_data_script": "#!/usr/bin/env python3\nimport py_helper\nprint('data', py_helper.B)\n",
    "py_plain/scripts/py_helper.py": "B = 2\n",
    "py_plain/launch/a.launch.py": "",
    "py_plain/launch/not_installed.txt": "",
    "py_plain/config/a.yaml": "a: 1\n",
    "py_plain/config/deep/b.yaml": "b: 1\n",
    "py_source/package.xml": _MANIFEST.format(name="py_source", kind="ament_python", more=""),
    "py_source/setup.py": _SOURCE_SETUP,
    "py_source/src/py_source/__init__.py": "",
    "py_source/src/py_source/tool.py": _MAIN,
    "cmake_all/package.xml": _MANIFEST.format(name="cmake_all", kind="ament_cmake", more=""),
    "cmake_all/CMakeLists.txt": _CMAKE,
    "cmake_all/launch/a.launch.xml": "<launch/>\n",
    "cmake_all/launch/deep/b.launch.yaml": "launch: []\n",
    "cmake_all/urdf/a.urdf": "<robot/>\n",
    "cmake_all/urdf/a.tmp": "",
    "cmake_all/urdf/old/b.urdf": "",
    "cmake_all/meshes/a.stl": "solid\n",
    "cmake_all/meshes/a.txt": "",
    "cmake_all/config/a.yaml": "a: 2\n",
    "cmake_all/config/b.yaml": "b: 2\n",
    "cmake_all/worlds/a.world": "<sdf/>\n",
    "cmake_all/scripts/node.py": "#!/usr/bin/env python3\nimport sys\nprint('node', sys.argv[1:])\n",
    "cmake_all/scripts/shell.sh": "#!/bin/sh\necho shell\n",
    "cmake_all/scripts/helper.py": "C = 3\n",
    "cmake_all/scripts/cmake_module.py": "D = 4\n",
    "cmake_all/cmake_all/__init__.py": "",
    "cmake_all/python/other/__init__.py": "",
    "cmake_all/resource/file.txt": "of a file\n",
    "cmake_auto/package.xml": _MANIFEST.format(name="cmake_auto", kind="ament_cmake", more=""),
    "cmake_auto/CMakeLists.txt": _AUTO,
    "cmake_auto/launch/a.launch.py": "",
    "cmake_auto/config/a.yaml": "a: 3\n",
    "some_msgs/package.xml": _MANIFEST.format(
        name="some_msgs",
        kind="ament_cmake",
        more="<depend>action_msgs</depend><member_of_group>rosidl_interface_packages</member_of_group>",
    ),
    "some_msgs/CMakeLists.txt": _MESSAGES,
    "some_msgs/msg/Plain.msg": "int32 value\n",
    "some_msgs/msg/NotListed.msg": "int32 value\n",
    "some_msgs/srv/Ask.srv": "int32 a\n---\nint32 b\n",
    "some_msgs/action/Go.action": "int32 a\n---\nint32 b\n---\nint32 c\n",
}
PROGRAMS = ("py_plain/scripts/py_data_script", "cmake_all/scripts/node.py")
"""Files that are executable."""
PACKAGES = sorted({path.split("/")[0] for path in FILES})
_QUESTIONS = """
import json
from ament_index_python import *
names = get_packages_with_prefixes()
kinds = ("packages", "rosidl_interfaces", "py_plugins", "cmake_texts", "cmake_files")
def of(package):
    try:
        return [get_package_prefix(package), get_package_share_directory(package)]
    except (PackageNotFoundError, ValueError) as error:
        return type(error).__name__
print(json.dumps({
    "prefixes": {name: names[name] for name in PACKAGES},
    "of": {name: of(name) for name in (*PACKAGES, "missing_package", "not-a/name")},
    "resources": {kind: sorted(set(get_resources(kind)) & set(PACKAGES)) for kind in kinds},
    "types": sorted(set(kinds) & get_resource_types()),
    "has": [bool(has_resource("packages", "py_plain")), bool(has_resource("cmake_texts", "py_plain"))],
    "texts": [get_resource(kind, "cmake_all")[0] for kind in ("cmake_texts", "cmake_files")],
}))
"""


def write_workspace(folder: Path) -> None:
    for path, text in FILES.items():
        file = folder / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        file.chmod(0o755 if path in PROGRAMS else 0o644)


def listing(prefix: Path) -> dict[str, Any]:
    """Return the files of a prefix that programs of ROS read; files that only builds and shells need are skipped."""
    index = prefix / "share/ament_index/resource_index"
    hidden = ("parent_prefix_path", "package_run_dependencies")
    resources = {
        f"{kind.name}/{file.name}": [line for line in file.read_text().splitlines() if not line.endswith(".idl")]
        for kind in index.iterdir()
        for file in kind.iterdir()
        if kind.name not in hidden and file.name in PACKAGES
    }
    share: dict[str, str] = {}
    for package in PACKAGES:
        for file in _files(prefix / "share" / package):
            path = file.relative_to(prefix / "share")
            is_of_build = path.parts[1] in ("cmake", "environment", "hook") or file.suffix == ".idl"
            is_of_shell = path.parts[1].partition(".")[0] in ("local_setup", "package") and file.suffix != ".xml"
            if not is_of_build and not is_of_shell:
                share[str(path)] = file.read_text()
    executables = [file for package in PACKAGES for file in _files(prefix / "lib" / package)]
    executables += [file for file in _files(prefix / "bin") if file.name.startswith("py_")]
    [site] = prefix.glob("lib/python3*/site-packages")
    return {
        "resources": dict(sorted(resources.items())),
        "share": dict(sorted(share.items())),
        "lib": {str(file.relative_to(prefix)): os.access(file, os.X_OK) for file in sorted(executables)},
        "modules": sorted(
            entry.name
            for entry in site.iterdir()
            if entry.suffix not in (".egg-info", ".dist-info", ".egg-link") and not entry.name.startswith(("_", "site"))
        ),
        "entry points": _entry_points(site),
    }


def _files(folder: Path) -> list[Path]:
    found = (Path(place, name) for place, _, names in os.walk(folder) for name in names)
    return [file for file in found if "__pycache__" not in file.parts]


def _entry_points(site: Path) -> dict[str, dict[str, dict[str, str]]]:
    """Return the entry points of each distribution, and its version."""
    found = {}
    for folder in site.iterdir():
        if folder.suffix in (".egg-info", ".dist-info"):
            file = folder / "entry_points.txt"
            parser = ConfigParser(delimiters="=")
            parser.optionxform = str  # type: ignore[assignment,method-assign]
            parser.read_string(file.read_text() if file.is_file() else "")
            text = (folder / ("METADATA" if folder.suffix == ".dist-info" else "PKG-INFO")).read_text()
            version = next(line.split(" ")[1] for line in text.splitlines() if line.startswith("Version: "))
            found[folder.name.partition("-")[0]] = {
                "version": {"": version},
                **{
                    group: {key: "".join(value.split()) for key, value in parser[group].items()}
                    for group in parser.sections()
                },
            }
    return dict(sorted(found.items()))


def answers(python: str, prefix: Path, environment: dict[str, str]) -> Any:
    """Return the results of ament_index_python for a prefix."""
    command = [python, "-c", f"PACKAGES = {PACKAGES}\n{_QUESTIONS}"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.replace(str(prefix), "PREFIX"))


def _record(base: Path) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_workspace(folder / "src")
        build = "colcon build --merge-install --cmake-args -DBUILD_TESTING=OFF"
        script = f". {base}/setup.sh && {build} && . install/setup.sh && env -0"
        done = subprocess.run(["sh", "-c", script], cwd=folder, capture_output=True, check=True)
        lines = done.stdout.split(b"\0")
        environment = dict(os.fsdecode(line).partition("=")[::2] for line in lines if b"=" in line)
        found = {
            **listing(folder / "install"),
            "ament_index_python": answers("python3", folder / "install", environment),
        }
    RECORDED.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n")


if __name__ == "__main__":
    _record(Path(sys.argv[1]).resolve())
