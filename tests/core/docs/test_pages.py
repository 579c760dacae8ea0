"""README.md and docs/ agree with the repository: links, tests, public names, and the length of the README."""

from __future__ import annotations

import ast
import inspect
import re
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest
from support.folders import ROOT
from support.markdown_pages import PAGES, anchors, find_test_file, links, named_tests, prose, rows

SITE = [page for page in PAGES if page.name != "README.md" and page.parent.name != "internals"]
MOST_WORDS_OF_A_SENTENCE = 40
BANNED = re.compile(
    r"\b(ours|theirs|any more|no longer|nobody|whoever|somebody|is told|are told|tells? of|meanwhile|what was tried)\b",
    re.I,
)
LINKING = [*PAGES, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "SECURITY.md"]
API = "\n".join(prose(page) for page in PAGES if page.parent.name == "api")


PARTS = ("runtime", "numpy", "message_filters", "tf", "bags")
SUBMODULES = ("runtime.qos", "runtime.pytest_plugin")
NAME = re.compile(r"`(?:await |async for |async with |not )?([A-Za-z_][\w.]*)")
OTHERS = {"async", "asyncio", "loop", "with", "f", "def", "T", "m", "Lock", "Event", "argv", "Future", "create_task"}
"""Names of Python and asyncio, and placeholders."""


def test_links_lead_to_existing_files_and_headings() -> None:
    for page in LINKING:
        for link in links(page):
            target, _, anchor = link.partition("#")
            path = (page.parent / target).resolve() if target else page
            assert path.exists(), f"{page.name}: {link}: no such file"
            is_heading = anchor and path.suffix == ".md"
            assert not is_heading or anchor in anchors(path), f"{page.name}: {link}: no such heading"


def section(heading: str) -> str:
    """Return the text of a section of docs/internals/parity.md."""
    text = prose(ROOT / "docs/internals/parity.md")
    (found,) = re.findall(rf"^## {heading}\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    return str(found)


@pytest.mark.parametrize(("heading", "folder", "least"), [("r2r", "runtime", 90), ("Other nodes", "interop_rclpy", 15)])
def test_tests_named_by_parity_page_exist(heading: str, folder: str, least: int) -> None:
    named = named_tests(section(heading))
    assert len(named) >= least
    for file, function in named:
        text = find_test_file(f"{folder}/{file}").read_text(encoding="utf-8")
        end = r"\w*\(" if function.endswith("…") else r"\("
        assert not function or re.search(rf"def {function.rstrip('…')}{end}", text), f"no {function} in {file}"


def runs_on_zenoh(file: Path, name: str) -> bool:
    if file.parent.name == "zenoh":
        return True
    wanted = (name or "test_…").replace("…", "*")
    text = file.read_text(encoding="utf-8")
    for test in ast.parse(text).body:
        if isinstance(test, ast.FunctionDef | ast.AsyncFunctionDef) and fnmatchcase(test.name, wanted):
            marks = " ".join(map(ast.unparse, test.decorator_list))
            used = {argument.arg for argument in test.args.args} | set(re.findall(r"usefixtures\('(\w+)'", marks))
            is_everywhere = "world" in used and "every_transport" in marks and "mark.on_zenoh" in text
            if ("network" in used or is_everywhere) and "without_zenoh" not in marks:
                return True
    return False


@pytest.mark.slow
def test_feature_that_works_on_zenoh_is_tested_there() -> None:
    table = [row for row in rows(ROOT / "docs/internals/parity.md") if len(row) == 5]
    start = table.index(["r2r", "Here", "State", "Zenoh", "Test"])
    others = table[start + 2 :]
    assert len(others) > 80
    for what, _, state, zenoh, tests in others:
        assert re.fullmatch(r"yes(, .+)?|same|no: .+|-", zenoh), what
        assert (zenoh == "-") == state.startswith("no"), what
        named = [(find_test_file(f"runtime/{file}"), name) for file, name in named_tests(tests)]
        assert not zenoh.startswith("yes") or any(runs_on_zenoh(*test) for test in named), what


def test_user_pages_name_no_tests() -> None:
    for page in SITE:
        named = [file for file, _ in named_tests(prose(page))]
        assert all((ROOT / "examples" / file.removeprefix("examples/")).exists() for file in named), page


@pytest.mark.parametrize("package", ["rosidl_py_gen", *(f"rosidl_py_gen.{name}" for name in PARTS)])
@pytest.mark.needs("mcap")
def test_every_public_name_is_on_an_api_page(package: str) -> None:
    shown = set(re.findall(rf"^::: rosidl_py_gen(?:\.(?:{'|'.join(PARTS)}))?\.(\w+)$", API, re.MULTILINE))
    module = import_module(package)
    own = {name for name, value in vars(module).items() if not (name.startswith("_") or isinstance(value, ModuleType))}
    names = set(getattr(module, "__all__", own))
    assert len(names) > 5 and names - shown == set()


@pytest.mark.needs("pyarrow")
def test_api_pages_show_only_existing_names() -> None:
    for name in re.findall(r"^::: (\S+)$", API, re.MULTILINE):
        module, _, attribute = name.rpartition(".")
        assert hasattr(__import__(module, fromlist=["_"]), attribute), name


def test_every_page_of_the_site_is_in_the_navigation() -> None:
    listed = set(re.findall(r"([\w/-]+\.md)$", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"), re.MULTILINE))
    assert listed - {"docs/internals/architecture.md"} >= {str(page.relative_to(ROOT / "docs")) for page in SITE}


@pytest.mark.parametrize("page", SITE, ids=lambda page: str(page.relative_to(ROOT / "docs")))
def test_user_pages_have_tags_short_sentences_and_no_banned_words(page: Path) -> None:
    text = prose(page)
    assert page.name == "index.md" or re.match(r"---\n(.*\n)*?tags: \[[^\]]+\]\n(.*\n)*?---\n", text), "no tags"
    assert "internals/" not in text
    assert [line for line in text.splitlines() if BANNED.search(line)] == []
    plain = re.sub(r"`[^`\n]*`|^[|=#<].*$|\]\([^)]*\)", " x ", text, flags=re.MULTILINE)
    sentences = re.split(r"[.:?!]\s|\n\n|\n[-*\d]", plain.partition("---\n")[2].partition("---\n")[2])
    assert [one for one in sentences if len(one.split()) > MOST_WORDS_OF_A_SENTENCE] == []


@pytest.mark.needs("pyarrow")
def test_paths_of_modules_and_names_in_prose_can_be_imported() -> None:
    for page in PAGES:
        for name in re.findall(r"`(rosidl_py_gen(?:\.\w+)+)", prose(page)):
            module, _, attribute = name.rpartition(".")
            try:
                import_module(name)
            except ModuleNotFoundError:
                assert hasattr(import_module(module), attribute), f"{page.name}: {name}"


def test_readme_has_at_most_125_lines() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 125


def test_pages_have_no_hidden_code() -> None:
    assert [page.name for page in PAGES if "<!-- test" in prose(page)] == []


def test_readme_figures_are_on_speed_page() -> None:
    (line,) = re.findall(r"^- \*\*Speed\*\*: (.*)$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    figures = re.findall(r"\d+(?:\.\d+)?", line)
    measured = set(re.findall(r"\d+(?:\.\d+)?", (ROOT / "docs/reference/speed.md").read_text(encoding="utf-8")))
    assert len(figures) >= 3 and set(figures) - measured == set()


def known_names() -> set[str]:
    """Return public names, members of public classes, and the parameters of these."""
    known: set[str] = set()
    for module in map(import_module, ["rosidl_py_gen", *(f"rosidl_py_gen.{part}" for part in (*PARTS, *SUBMODULES))]):
        for name in dir(module):
            value = getattr(module, name)
            known.add(name)
            if inspect.isclass(value):
                known |= set(dir(value))
                for member in (inspect.getattr_static(value, attribute) for attribute in dir(value)):
                    if inspect.isfunction(member):
                        known |= set(inspect.signature(member).parameters)
    return known


@pytest.mark.needs("mcap")
def test_names_in_tables_for_rclpy_users_exist() -> None:
    known = known_names()
    found = rows(ROOT / "docs/start/rclpy-names.md")
    table = [row for row in found[found.index(["rclpy", "rosidl-py-gen"]) :] if not row[0].startswith("-")]
    assert len(table) > 65
    named = {(row[0], name) for row in table for name in NAME.findall(row[1])}
    parts = {(what, part) for what, name in named for part in name.split(".") if not name.startswith("rosidl_py_gen")}
    assert len(parts) > 90
    assert {(what, part) for what, part in parts if part not in known | OTHERS} == set()
    for module in {name for _, name in named if name.startswith("rosidl_py_gen")}:
        parent, _, attribute = module.rpartition(".")
        assert hasattr(import_module(parent), attribute) or import_module(module)


def test_howto_index_links_to_every_howto_page() -> None:
    index = set(links(ROOT / "docs/howto/index.md"))
    assert {page.name for page in SITE if page.parent.name == "howto"} - {"index.md"} - index == set()
