"""Install rules of setup.py: 80 idioms of public packages, alone and combined, against setuptools."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Protocol

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.setup_idioms import AROUND, DYNAMIC, ENDS, STATIC, Installer, is_compared, is_program, write_package

from rosidl_py_gen.prefix.package_plan import PackagePlan

pytestmark = [
    pytest.mark.real_time("setup.py runs in processes"),
    pytest.mark.skipif(os.name == "nt", reason="there is no prefix"),
]
EXCLUSIVE = ("local function with the name of another", "own package", "console scripts of a comprehension")
"""Idioms that other code cannot contain, or that would repeat a name."""


class Case(Protocol):
    """Comparison of a package of some idioms with what setuptools installs; returns True for a certain reading."""

    def __call__(self, names: Sequence[str], end: str, around: Sequence[str] = ()) -> bool: ...


@pytest.fixture(scope="module")
def compare(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Case]:
    if find_spec("setuptools") is None:  # not imported: another test may have imported the distutils of Python
        pytest.skip("needs setuptools")
    installer = Installer()
    top = tmp_path_factory.mktemp("idioms")
    count = iter(range(10_000))

    def compare(names: Sequence[str], end: str, around: Sequence[str] = ()) -> bool:
        place = top / str(next(count))
        write_package(place / "foo", names, end, around)
        static = PackagePlan("foo", place / "foo")  # first, before setup.py can create files
        exact = PackagePlan("foo", place / "foo", runs_setup=True)
        installed = installer.install(place / "foo", place / "out")
        assert exact.notes == [] and exact.problems == []
        assert _contents(exact) == installed
        contents = _contents(static)
        is_certain = not static.notes and not static.problems
        if is_certain:
            assert contents == installed
        elif "created files" not in names:
            known = {*contents.values()}
            assert all(text in known for path, text in installed.items() if path.startswith("share/"))
        return is_certain

    yield compare
    installer.close()


def _contents(plan: PackagePlan) -> dict[str, str]:
    found = {}
    for place, file in plan.files.items():
        if is_compared(place):
            text = (file.content or b"").decode() if file.source is None else ""
            found[place] = "" if is_program(place) else file.source.read_text() if file.source else text
    return found


@pytest.mark.parametrize("name", [*STATIC, *DYNAMIC])
def test_each_idiom_installs_the_files_of_setuptools_or_is_uncertain(name: str, compare: Case) -> None:
    assert compare([name], "plain") is (name in STATIC)


@pytest.mark.parametrize("end", ENDS)
def test_forms_of_the_setup_call_are_read_without_running_them(end: str, compare: Case) -> None:
    assert compare(["append", "console scripts of files"], end)


_KNOWN = st.lists(st.sampled_from([*STATIC]), min_size=2, max_size=6)
_MIXED = st.lists(st.sampled_from([*STATIC, *DYNAMIC]), min_size=2, max_size=6)


@settings(max_examples=15, deadline=None)
@given(names=st.one_of(_KNOWN, _MIXED), end=st.sampled_from([*ENDS]))
def test_combined_idioms_install_the_files_of_setuptools_or_are_uncertain(
    names: list[str], end: str, compare: Case
) -> None:
    assert compare(names, end) is {*names}.isdisjoint(DYNAMIC)


@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_files_of_idioms_in_other_code_are_never_lost(data: st.DataObject, compare: Case) -> None:
    idioms = [name for name, code in {**STATIC, **DYNAMIC}.items() if name not in EXCLUSIVE and "global " not in code]
    names = data.draw(st.lists(st.sampled_from(idioms), min_size=1, max_size=3, unique=True))
    around = [data.draw(st.sampled_from([*AROUND])) for _ in names]
    compare(names, "plain", around)


@pytest.mark.parametrize("around", AROUND)
def test_files_of_idioms_nested_in_each_kind_of_code_are_never_lost(around: str, compare: Case) -> None:
    compare(["augmented by a call", "console scripts of files"], "plain", [around, around])
