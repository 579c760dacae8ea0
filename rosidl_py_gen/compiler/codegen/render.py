"""Fill the templates. The only file that imports jinja2, and only when there is something to print: that takes 30 ms.

A wheel holds the templates as jinja2 compiled them (`hatch_build.py`) and their texts, for a jinja2 that cannot use
those; a checkout holds the texts.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from rosidl_py_gen.base import resources
from rosidl_py_gen.compiler.codegen.python_literals import docstring, py_string

if TYPE_CHECKING:
    from jinja2 import Environment

    from rosidl_py_gen.compiler.codegen.template_model import AliasView, KindView, ModuleView


def environment_of_texts() -> Environment:
    """What templates may call, and their texts."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    environment = Environment(
        loader=FileSystemLoader(resources.templates_dir()),
        undefined=StrictUndefined,
        autoescape=select_autoescape(()),  # Python, not HTML; literals pass through `string` and `docstring`
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "docstring": lambda lines, indent: docstring(lines, " " * indent),
        "string": py_string,
        "code": _indented,
    }
    return environment


def _indented(text: str, indent: int = 0) -> str:
    return "\n".join(" " * indent + line if line.strip() else "" for line in text.splitlines())


@lru_cache(maxsize=1)
def _environment() -> Environment:
    from jinja2 import ChoiceLoader, ModuleLoader

    environment = environment_of_texts()
    assert environment.loader is not None
    compiled = ModuleLoader(resources.compiled_templates_dir())
    environment.loader = ChoiceLoader([compiled, environment.loader])
    return environment


def load() -> None:
    """Import jinja2 and read the template of modules, which the first page else waits for."""
    _environment().get_template("module.py.jinja")


def _render(template: str, **values: object) -> str:
    return _environment().get_template(template).render(values)


def render_module(view: ModuleView) -> str:
    """The source of an interface's module."""
    return _render("module.py.jinja", module=view)


def render_alias(view: AliasView) -> str:
    """The source of a module that hands on another one's classes."""
    return _render("alias.py.jinja", alias=view)


def render_kind(view: KindView) -> str:
    """The ``__init__`` of a package's msg, srv or action folder."""
    return _render("kind_init.py.jinja", kind=view)


def render_package(name: str) -> str:
    """The ``__init__`` of a package."""
    return _render("package_init.py.jinja", package=name)
