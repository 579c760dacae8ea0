"""Consistency of a release: versions, supported CPythons, and workflows that run the commands of README and .ci/run.

`.ci/run` checks the schemas of workflows and of CITATION.cff.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.folders import ROOT
from support.markdown_pages import prose, rows

import rosidl_py_gen

WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
PROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
in_a_checkout = pytest.mark.skipif(not WORKFLOWS, reason="a source archive has no workflows")


def jobs(path: Path) -> dict[str, Any]:
    found = yaml.safe_load(path.read_text(encoding="utf-8"))["jobs"]
    assert isinstance(found, dict)
    return found


def steps() -> list[tuple[str, dict[str, Any]]]:
    return [(path.name, step) for path in WORKFLOWS for job in jobs(path).values() for step in job.get("steps", ())]


def requirements(extra: str) -> set[str]:
    (listed,) = re.findall(rf"^{extra} = \[(.*?)\]$", PROJECT, re.MULTILINE | re.DOTALL)
    found = set()
    for one in re.findall(r'"([^"]+)"', listed):
        ours = re.fullmatch(r"rosidl-py-gen\[(.*)\]", one)
        found |= set().union(*map(requirements, ours[1].split(","))) if ours else {one}
    return found


def test_version_is_the_same_in_project_package_citation_site_and_changelog() -> None:
    (version,) = re.findall(r'^version = "(.+)"$', PROJECT, re.MULTILINE)
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert rosidl_py_gen.__version__ == version == citation["version"]
    (line,) = re.findall(r"^copyright: (.*)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE)
    assert line.startswith(f"rosidl-py-gen {version} ·") and f">{citation['license']}</a>" in line
    assert f"\n## {version} (" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_citation_agrees_with_project_metadata() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    for name, key in (("name", "title"), ("license", "license"), ("description", "abstract")):
        assert f'\n{name} = "{citation[key]}"\n' in PROJECT
    assert all(f'"{word}"' in PROJECT for word in citation["keywords"])


@in_a_checkout
def test_supported_cpython_versions_are_tested_in_ci() -> None:
    supported = re.findall(r"Python :: (3\.\d+)\"", PROJECT)
    (documented,) = [row[1] for row in rows(ROOT / "docs/reference/versions.md") if row[0] == "CPython"]
    tried = jobs(ROOT / ".github/workflows/ci.yml")["machines"]["strategy"]["matrix"]["python"]
    assert documented.split(", ") == supported == tried
    assert f'requires-python = ">={supported[0]}"' in PROJECT


@in_a_checkout
def test_workflows_run_only_commands_of_readme_contributing_and_ci() -> None:
    known = (ROOT / "README.md").read_text(encoding="utf-8") + (ROOT / ".ci/run").read_text(encoding="utf-8")
    known += prose(ROOT / "CONTRIBUTING.md").replace("\n", " ")
    words = " ".join(known.split())
    lines = [line for _, step in steps() for line in step.get("run", "").splitlines()]
    assert [line for line in lines if line not in words] == [
        "apt-get update -qq && apt-get install -y -qq --no-install-recommends ca-certificates git python3 python3-venv",
        'pip install ".[zenoh]"',
        "python examples/messages.py",
        'test -z "$(git status --porcelain)"',
        "pip install -e '.[${{ env.HAS_DDS == 'true' && 'test' || 'test-without-dds' }}]'",
        "pytest tests/core/runtime/entities/test_services.py tests/core/runtime/transport/test_fast_dds_rules.py",
        "pip install build",
        'test -f "dist/rosidl_py_gen-${GITHUB_REF_NAME#v}.tar.gz"',
    ]


@in_a_checkout
@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflow_permissions_are_minimal(path: Path) -> None:
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert workflow["permissions"] in ({}, {"contents": "read"}) and workflow["concurrency"]["group"]
    for name, job in workflow["jobs"].items():
        assert "uses" in job or job["timeout-minutes"] <= 150
        allowed = set(job.get("permissions", {}).items())
        if any(access == "write" for _, access in allowed):
            assert job["environment"]["name"], f"{name} may write, so somebody has to allow it"
            assert not any("run" in step for step in job["steps"]), f"{name} may write, and runs what is here"


@in_a_checkout
def test_actions_are_pinned_to_commits_of_one_version() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in WORKFLOWS)
    used = re.findall(r"^ +(?:- )?uses: (?!\./)(.+)$", text, re.MULTILINE)
    assert len(used) > 8
    assert [one for one in used if not re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", one)] == []
    assert len({one.partition("@")[0] for one in used}) == len(set(used)), "one version of each"


@pytest.mark.parametrize("extra", ["images", "mcap", "plot", "cluster", "foxglove", "zenoh", "test-without-dds"])
def test_extras_without_dds_do_not_require_cyclonedds(extra: str) -> None:
    assert requirements(extra) <= requirements("test-all") - requirements("node") | {"pyyaml>=6.0", "rich>=13.7"}
    assert any(one.startswith("cyclonedds") for one in requirements("node"))
