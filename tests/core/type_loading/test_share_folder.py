"""Files that packages install, read from their sources, and the share folder made of them."""

from __future__ import annotations

import os
import sys
import textwrap
from pathlib import Path

import pytest

from rosidl_py_gen.prefix.executables import of_sources
from rosidl_py_gen.type_loading.share_folder import share_folder

SETUP = """
import os
from glob import glob
from setuptools import setup

package_name = "pack"
data_files = [
    ("share/ament_index/resource_index/packages", ["resource/" + package_name]),
    ("share/" + package_name, ["package.xml"]),
{rows}
]
{more}
setup(name=package_name, data_files=data_files)
"""
FILES = (
    *(
        "package.xml",
        "resource/pack",
        "launch/a.launch.py",
        "launch/b.launch.py",
        "config/a.yaml",
        "config/deep/b.yaml",
    ),
    *("scripts/tool.py", "scripts/text.txt", "scripts/.hidden.py", "pack/__init__.py", "other.py"),
)


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROSIDL_PY_GEN_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in FILES:
        (tmp_path / "pack" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "pack" / name).write_text(name)
    return tmp_path / "pack"


def write_setup(folder: Path, rows: str, more: str = "") -> None:
    (folder / "setup.py").write_text(SETUP.format(rows=textwrap.indent(rows, "    "), more=more))


def write_cmake(folder: Path, text: str) -> None:
    (folder / "CMakeLists.txt").write_text(f"project(pack)\n{text}\n")


FLATTENED = {
    "launch": ("('share/' + package_name, glob('launch/*.launch.py')),", "", {"a.launch.py": "launch/a.launch.py"}),
    "with join": (
        "(os.path.join('share', package_name), glob(os.path.join('launch', '*'))),",
        "",
        {"b.launch.py": "launch/b.launch.py"},
    ),
    "renamed folder": (
        "(f'share/{package_name}/params', glob('config/*.yaml')),",
        "",
        {"params/a.yaml": "config/a.yaml"},
    ),
    "other folder of that name": (
        "('share/pack/launch', ['other.py']),",
        "",
        {"launch/other.py": "other.py", "launch/a.launch.py": "launch/a.launch.py"},
    ),
    "recursive": ("('share/pack', glob('config/**/*.yaml', recursive=True)),", "", {"b.yaml": "config/deep/b.yaml"}),
    "appended": ("", "data_files.append(('share/pack', ['config/a.yaml']))", {"a.yaml": "config/a.yaml"}),
    "added": ("", "data_files += [('share/pack', [*glob('config/*.yaml')])]", {"a.yaml": "config/a.yaml"}),
}
IN_CMAKE = {
    "files": ("install(FILES config/a.yaml DESTINATION share/${PROJECT_NAME})", {"a.yaml": "config/a.yaml"}),
    "renamed": ("install(FILES config/a.yaml DESTINATION share/pack RENAME c.yaml)", {"c.yaml": "config/a.yaml"}),
    "folder": (
        "install(DIRECTORY config/ launch DESTINATION share/${PROJECT_NAME}/)",
        {"a.yaml": "config/a.yaml", "deep/b.yaml": "config/deep/b.yaml", "launch/a.launch.py": "launch/a.launch.py"},
    ),
    "below": (
        "install(DIRECTORY launch config DESTINATION share/${PROJECT_NAME}/all PATTERN x EXCLUDE)",
        {"all/config/a.yaml": "config/a.yaml", "all/launch/a.launch.py": "launch/a.launch.py"},
    ),
}


@pytest.mark.skipif(sys.platform == "win32", reason="links need a right there")
@pytest.mark.parametrize("name", [*FLATTENED, *IN_CMAKE])
def test_share_folder_has_files_where_the_installation_puts_them(folder: Path, name: str) -> None:
    if name in FLATTENED:
        rows, more, expected = FLATTENED[name]
        write_setup(folder, rows, more)
    else:
        text, expected = IN_CMAKE[name]
        write_cmake(folder, text)
    for _ in range(2):  # the second time the folder exists already
        share = share_folder("pack", folder)
        assert share != folder and share.name == "pack"
        assert {place: (share / place).read_text() for place in expected} == expected
        assert (
            share / "config/deep/b.yaml"
        ).read_text() == "config/deep/b.yaml"  # what is in the sources is there, too


@pytest.mark.parametrize(
    "rows",
    [
        "('share/pack/launch', glob('launch/*')), ('share/pack/config', ['config/a.yaml']),",
        "('share/pack', glob('../*')), ('share/pack', glob('/etc/*')), ('share/other', ['other.py']),",
        "(unknown(), ['other.py']), ('share/pack', unknown('launch')), ('share/pack', ['missing']), 5,",
    ],
)
def test_source_folder_is_the_share_folder_if_installation_keeps_all_paths(folder: Path, rows: str) -> None:
    write_setup(folder, rows)
    write_cmake(folder, "install(DIRECTORY launch config DESTINATION share/pack)")
    assert share_folder("pack", folder) == folder
    (folder / "setup.py").write_text("setup(")
    assert share_folder("pack", folder) == folder


@pytest.mark.skipif(sys.platform == "win32", reason="links need a right there")
def test_share_folder_links_follow_the_sources_and_files_of_programs_remain(folder: Path) -> None:
    write_setup(folder, FLATTENED["launch"][0])
    share = share_folder("pack", folder)
    (share / "saved.yaml").write_text("saved")
    os.replace(share / "saved.yaml", share / "other.py")
    (folder / "launch/a.launch.py").unlink()
    (folder / "launch/new.launch.py").write_text("new")
    assert share_folder("pack", folder) == share
    assert sorted(path.name for path in share.iterdir() if path.name.endswith("launch.py")) == [
        "b.launch.py",
        "new.launch.py",
    ]
    assert (share / "other.py").read_text() == "saved"


def test_python_files_that_cmake_installs_into_lib_are_executables(folder: Path) -> None:
    write_cmake(
        folder,
        """
        install(FILES scripts/tool.py scripts/text.txt DESTINATION lib/${PROJECT_NAME})
        install(FILES other.py DESTINATION lib/${PROJECT_NAME} PERMISSIONS OWNER_EXECUTE RENAME another.py)
        install(DIRECTORY scripts/ DESTINATION lib/${PROJECT_NAME} USE_SOURCE_PERMISSIONS)
        install(FILES launch/a.launch.py DESTINATION share/${PROJECT_NAME}/launch)
        """,
    )
    assert {name: one.file for name, one in of_sources(folder).items()} == {
        "tool.py": folder / "scripts/tool.py",
        "another.py": folder / "other.py",
    }


def test_a_cmake_file_that_cannot_be_read_is_reported(folder: Path) -> None:
    (folder / "CMakeLists.txt").write_text("#" * (2 << 20))
    texts: list[str] = []
    assert share_folder("pack", folder, problem=texts.append) == folder
    assert len(texts) == 1 and "CMakeLists.txt installs is not known: " in texts[0]
