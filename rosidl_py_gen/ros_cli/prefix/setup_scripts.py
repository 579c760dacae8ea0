"""Setup scripts of a prefix for shells, and its module for Python."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable
from pathlib import Path

from rosidl_py_gen.base.distributions import DISTRIBUTIONS, ENVIRONMENT_VARIABLE
from rosidl_py_gen.compiler.frontend.bundled import bundled_packages
from rosidl_py_gen.ros_cli import CommandError
from rosidl_py_gen.ros_cli.prefix.package_plan import COMPANIONS, INDEX, PackagePlan, PrefixFile
from rosidl_py_gen.ros_cli.prefix.variables import FIXED, SITE_PACKAGES, folders, of_distribution


def files(prefix: Path, plans: Iterable[PackagePlan]) -> dict[str, PrefixFile]:
    """Return the files at the top of a prefix, and the module ``sitecustomize``, by their paths."""
    if os.pathsep in str(prefix):
        raise CommandError(f'{prefix}: a prefix must not have "{os.pathsep}" in its path, which separates folders')
    names = {name for distro in DISTRIBUTIONS for name in bundled_packages(distro)}
    names |= {plan.name for plan in plans if f"{INDEX}/rosidl_interfaces/{plan.name}" in plan.files}
    names |= {*COMPANIONS, "rosidl_parser"}
    template = Path(__file__).with_name("sitecustomize_template.py").read_text(encoding="utf-8")
    texts = {
        "COLCON_IGNORE": "",
        **dict.fromkeys(("setup.sh", "setup.bash", "setup.zsh"), _posix_script(prefix)),
        "setup.fish": _fish_script(prefix),
        f"{SITE_PACKAGES}/sitecustomize.py": template.replace("frozenset(())", f"frozenset({sorted(names)})"),
    }
    return {place: PrefixFile(content=os.fsencode(text)) for place, text in texts.items()}


def _posix_script(prefix: Path) -> str:
    lines = [f"export {name}={value}" for name, value in FIXED.items()]
    for name, value in of_distribution().items():
        lines.append(f'[ -n "${{{ENVIRONMENT_VARIABLE}:-}}" ] || export {name}={value}')
    for name, folder in folders(prefix).items():
        quoted, old = shlex.quote(str(folder)), f"${{{name}:+:${{{name}}}}}"
        lines.append(f'case "{old}:" in *:{quoted}:*) ;; *) export {name}={quoted}"{old}" ;; esac')
    return "\n".join(lines) + "\n"


def _fish_script(prefix: Path) -> str:
    lines = [f"set -gx {name} {value}" for name, value in FIXED.items()]
    for name, value in of_distribution().items():
        lines.append(f'test -n "${ENVIRONMENT_VARIABLE}"; or set -gx {name} {value}')
    for name, folder in folders(prefix).items():
        quoted = "'" + str(folder).replace("\\", "\\\\").replace("'", "\\'") + "'"
        value = f"{quoted} $PATH" if name == "PATH" else f"(string join : -- {quoted} ${name})"
        lines.append(f'contains -- {quoted} (string split : -- "${name}"); or set -gx {name} {value}')
    return "\n".join(lines) + "\n"
