"""Wheel of the C library, without compiling it: metadata, and the version of a source tree.

packaging/libddsc/README.md has the commands that build and try it.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest
import yaml
from support.markdown_pages import ROOT

FOLDER = ROOT / "packaging" / "libddsc"
WORKFLOW = ROOT / ".github" / "workflows" / "libddsc.yml"
pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="a source archive has no packaging")


def module(name: str) -> ModuleType:
    """A file of the folder, which is on no path."""
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    assert spec is not None and spec.loader is not None
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def version_of(monkeypatch: pytest.MonkeyPatch, named: str | Path) -> str:
    monkeypatch.setenv("CYCLONEDDS_SOURCE", str(named))
    version = module("source_tree").dynamic_metadata({}, {})["version"]
    assert isinstance(version, str)
    return version


@pytest.mark.parametrize(
    "declared", ["project(CycloneDDS VERSION 0.10.5 LANGUAGES C)", "project ( CycloneDDS VERSION 0.10.5 )"]
)
def test_the_version_is_that_of_the_source_tree(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, declared: str) -> None:
    (tmp_path / "CMakeLists.txt").write_text(f"cmake_minimum_required(VERSION 3.16)\n{declared}\n")
    assert version_of(monkeypatch, tmp_path) == "0.10.5"


def test_without_a_source_tree_the_error_says_what_to_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(Exception, match=r"^CYCLONEDDS_SOURCE is not set; it has to name a source tree of Cyclone DDS"):
        version_of(monkeypatch, "")
    with pytest.raises(Exception, match=r"^CYCLONEDDS_SOURCE=cyclonedds: expected a whole path"):
        version_of(monkeypatch, "cyclonedds")
    with pytest.raises(Exception, match=re.escape(f"CYCLONEDDS_SOURCE={tmp_path}: expected a source tree")):
        version_of(monkeypatch, tmp_path)
    (tmp_path / "CMakeLists.txt").write_text("project(something VERSION 1.0)\n")
    with pytest.raises(Exception, match=r'expected "project\(CycloneDDS VERSION'):
        version_of(monkeypatch, tmp_path)


def test_one_wheel_serves_every_interpreter_and_has_the_terms_of_cyclone() -> None:
    project = (FOLDER / "pyproject.toml").read_text(encoding="utf-8")
    assert re.findall(r'^(?:name|license|wheel\.py-api) = "(.+?)"', project, re.MULTILINE) == [
        "rosidl-libddsc",
        "EPL-2.0 OR BSD-3-Clause",
        "py3",
    ]
    assert '"${source}/LICENSE" "${source}/NOTICE.md"' in (FOLDER / "CMakeLists.txt").read_text(encoding="utf-8")
    ours = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert re.findall(r'^requires-python = ".+"$', project, re.MULTILINE) == re.findall(
        r'^requires-python = ".+"$', ours, re.MULTILINE
    )


def test_the_package_names_the_one_file(tmp_path: Path) -> None:
    text = (FOLDER / "src/rosidl_libddsc/__init__.py").read_text(encoding="utf-8")
    (tmp_path / "lib").mkdir()
    library = tmp_path / "lib" / "libddsc.so.0.10.5"
    library.touch()
    installed = {"__file__": str(tmp_path / "__init__.py")}
    exec(text.replace('version("rosidl-libddsc")', '"0.10.5"'), installed)
    path = installed["path"]
    assert callable(path) and path() == library


@pytest.mark.skipif(not WORKFLOW.exists(), reason="a source archive has no workflows")
def test_nothing_is_published_before_every_platform_has_its_wheel() -> None:
    jobs = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))["jobs"]
    made = jobs["build"]["strategy"]["matrix"]["include"]
    assert jobs["publish"]["needs"] == "gather" and jobs["gather"]["needs"] == "build"
    (counted,) = [step["run"] for step in jobs["gather"]["steps"] if "run" in step]
    assert counted.endswith(f"= {len(made)}")
