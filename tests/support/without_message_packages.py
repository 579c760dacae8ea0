"""Restart of pytest in an environment without the message packages that `rosidl-py-gen --install` has installed.

README's main command installs them, and its test command follows in the same environment. An installed package precedes
the bundled one, so tests of definitions, imports and wheels would test other code, in this process and in the processes
that they start. The other environment has links to everything else that is installed.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import venv
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from rosidl_py_gen.base.resources import InstalledInterfaces
from support.environments import cache_folder

_IS_WINDOWS = os.name == "nt"


def restart_without_message_packages(config: pytest.Config) -> None:
    """Replace this process by the same pytest in the other environment; does nothing without message packages."""
    hidden = installed_files(Path(sysconfig.get_path("purelib")))
    if not hidden:
        return
    python = environment_without(Path(sys.prefix), hidden)
    capture = config.pluginmanager.getplugin("capturemanager")
    if capture is not None:
        capture.stop_global_capturing()  # the new process needs the original standard output
    flags = subprocess._args_from_interpreter_flags()  # type: ignore[attr-defined]
    # Like the program pytest, not like `python -m pytest`, which makes the modules of the current folder importable.
    start = "import sys; del sys.path[0]; import pytest; sys.exit(pytest.main())"
    command = [str(python), *flags, "-c", start, *map(str, config.invocation_params.args)]
    os.chdir(config.invocation_params.dir)
    sys.stdout.flush()
    if (
        "support.generated_packages" in sys.modules
    ):  # a conftest has made them; functions of atexit are not called below
        sys.modules["support.generated_packages"].GENERATED.cleanup()
    if _IS_WINDOWS:  # execv would return to the shell at once
        os._exit(subprocess.run(command, check=False).returncode)
    os.execv(command[0], command)


def installed_files(site: Path) -> set[str]:
    """Return the names in site-packages that belong to message packages: modules and metadata."""
    names: set[str] = set()
    for entry in entry_points(group=InstalledInterfaces.ENTRY_POINTS):
        dist = entry.dist
        if dist is not None and Path(str(dist.locate_file(""))).resolve() == site.resolve():
            names |= {file.parts[0] for file in dist.files or () if file.parts[0] != os.pardir}
    return names


def environment_without(prefix: Path, hidden: set[str]) -> Path:
    """Return the Python of an environment that has all files of `prefix` but the hidden names of site-packages."""
    site = Path(sysconfig.get_path("purelib", vars={"base": str(prefix)}))
    shown = sorted(path.name for path in site.iterdir() if path.name not in hidden | {"__pycache__"})
    key = hashlib.sha256("\n".join([str(prefix), sys.version, *shown]).encode()).hexdigest()[:12]
    folder = cache_folder() / f"without-messages-{key}"
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent, prefix="without-messages-") as partial:
            made = Path(partial, "environment")
            venv.EnvBuilder(symlinks=not _IS_WINDOWS).create(made)
            twin = Path(sysconfig.get_path("purelib", vars={"base": str(made)}))
            for name in shown:
                _link(site / name, twin / name)
            for name in ("share", "etc"):  # kernels of Jupyter, for example
                if (prefix / name).exists() and not (made / name).exists():
                    _link(prefix / name, made / name)
            scripts, own = (Path(sysconfig.get_path("scripts", vars={"base": str(one)})) for one in (prefix, made))
            for path in scripts.iterdir():
                if not (own / path.name).exists() and not path.name.startswith(("python", "activate")):
                    _link(path, own / path.name)
            try:
                made.rename(folder)
            except OSError:  # another process was faster
                if not folder.exists():
                    raise
    return Path(sysconfig.get_path("scripts", vars={"base": str(folder)}), f"python{sysconfig.get_config_var('EXE')}")


def _link(source: Path, target: Path) -> None:
    if not _IS_WINDOWS:
        target.symlink_to(source)
    elif source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copy2(source, target)
