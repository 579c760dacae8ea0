"""What pages say that there is, there is: names in the column "here" of the migration table; nothing is "not yet"."""

from __future__ import annotations

import inspect
import re
from importlib import import_module

from support.markdown_pages import PAGES, ROOT, links, prose, rows

MODULES = [
    "rosidl_py_gen",
    *(
        f"rosidl_py_gen.{part}"
        for part in ("runtime", "runtime.qos", "runtime.pytest_plugin", "numpy", "message_filters", "tf", "bags")
    ),
]
NAME = re.compile(r"`(?:await |async for |async with )?([A-Za-z_][\w.]*)")
# Not ours: Python's and asyncio's, and placeholders.
OTHERS = {"async", "asyncio", "loop", "with", "f", "def", "T", "m", "Lock", "Event", "call_soon_threadsafe"}


def known_names() -> set[str]:
    """Public names, those of the methods and attributes of public classes, and the parameters of these."""
    known: set[str] = set()
    for module in map(import_module, MODULES):
        for name in dir(module):
            value = getattr(module, name)
            known.add(name)
            if inspect.isclass(value):
                known |= set(dir(value))
                for member in vars(value).values():
                    if inspect.isfunction(member):
                        known |= set(inspect.signature(member).parameters)
    return known


def test_what_the_migration_table_names_exists() -> None:
    known, table = known_names(), [row for row in rows(ROOT / "docs/migration.md") if len(row) == 4][2:]
    assert len(table) > 35
    named = {(row[0], name) for row in table for name in NAME.findall(row[2])}
    parts = {(what, part) for what, name in named for part in name.split(".") if not name.startswith("rosidl_py_gen")}
    assert len(parts) > 50
    missing = {(what, part) for what, part in parts if part not in known | OTHERS}
    assert missing == set()
    for module in {name for _, name in named if name.startswith("rosidl_py_gen")}:
        import_module(module)


def test_nothing_is_announced_for_later() -> None:
    told = [page.name for page in PAGES if re.search(r"\bnot yet\b:|\bcoming soon\b|\bTODO\b", prose(page))]
    assert told == []


def test_the_first_page_leads_to_every_guide_and_api_page() -> None:
    index = set(links(ROOT / "docs/index.md"))
    pages = {f"{page.parent.name}/{page.name}" for page in PAGES if page.parent.name in ("guide", "api")}
    assert pages - index == set()


def test_the_comparison_says_of_this_package_what_it_has() -> None:
    (own,) = [row for row in rows(ROOT / "docs/compare.md") if "rosidl-py-gen" in row[0]]
    assert "MCAP" in own[6] and "SQLite" in own[6]
    for word in ("Cyclone DDS", "Zenoh", "topics", "services", "actions", "parameters", "lifecycle", "tf"):
        assert word in own[7]
