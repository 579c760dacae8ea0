"""Python source of generated packages, rendered from checked definitions by jinja2 templates.

A wheel contains the templates in two forms: as text, and compiled by jinja2 (`hatch_build.py`). The texts are used if
the installed jinja2 cannot load the compiled templates. A source checkout has only the texts.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from rosidl_py_gen.base import resources
from rosidl_py_gen.base.generated_classes import GENERATED_HEADER
from rosidl_py_gen.compiler.codegen.layout_planner import LayoutPlanner
from rosidl_py_gen.compiler.codegen.naming import sort_key
from rosidl_py_gen.compiler.codegen.python_literals import docstring, py_string
from rosidl_py_gen.compiler.codegen.template_model import Target, exported_names, module_name, module_view

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from jinja2 import Environment

    from rosidl_py_gen.base.names import RosName
    from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry


def environment_of_texts() -> Environment:
    """Return a jinja2 environment, with the filters of the templates, that loads the texts of the templates instead of
    compiled ones.
    """
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
    from jinja2 import ChoiceLoader, ModuleLoader  # takes 30 ms to import

    environment = environment_of_texts()
    assert environment.loader is not None
    compiled = ModuleLoader(resources.compiled_templates_dir())
    environment.loader = ChoiceLoader([compiled, environment.loader])
    return environment


def preload() -> None:
    """Import jinja2 and load the module template, to save time when the first module is rendered."""
    _environment().get_template("module.py.jinja")


def render(template: str, **values: object) -> str:
    """Return the text of the template with this name, rendered with the values as its variables."""
    return _environment().get_template(template).render(values)


def module_source(registry: InterfaceRegistry, name: RosName, planner: LayoutPlanner, target: Target) -> str:
    """Return the source of an interface's module; the interface and all types that it refers to must be valid."""
    interface = registry.interface(name)
    assert interface is not None, name
    origin = target.known(str(name))
    if origin is None:
        return render("module.py.jinja", module=module_view(interface, planner, target))
    names = sorted(exported_names(interface), key=sort_key)
    return render("alias.py.jinja", ros_name=str(name), origin=origin, names=names)


def package_sources(
    registry: InterfaceRegistry,
    names: Iterable[RosName],
    target: Target,
    progress: Callable[[RosName], object] = lambda name: None,
) -> dict[str, str]:
    """Return the source files of the packages of valid interfaces, as a dictionary from relative path to text.

    Args:
        progress: called with the name of each interface before its module is rendered.
    """
    planner = LayoutPlanner(registry.message)
    files: dict[str, str] = {}
    exports: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for name in names:
        progress(name)
        module = module_name(name.name)
        files[f"{name.package}/{name.kind}/{module}.py"] = module_source(registry, name, planner, target)
        interface = registry.interface(name)
        assert interface is not None
        classes = exports.setdefault((name.package, name.kind), [])
        classes += [(cls, module) for cls in exported_names(interface)]
    for (package, kind), classes in exports.items():
        files[f"{package}/{kind}/__init__.py"] = render(
            "kind_init.py.jinja",
            root=target.root,
            package=package,
            kind=kind,
            exports=sorted(classes, key=lambda row: (sort_key(row[1]), sort_key(row[0]))),
            names=sorted((cls for cls, _ in classes), key=sort_key),
        )
        files[f"{package}/__init__.py"] = render("package_init.py.jinja", package=package)
        files[f"{package}/py.typed"] = f"{GENERATED_HEADER}: the package is typed (PEP 561). Do not edit.\n"
    return dict(sorted(files.items()))
