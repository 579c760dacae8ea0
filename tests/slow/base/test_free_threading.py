"""Free-threaded Python: no module of the package makes it enable the GIL."""

from __future__ import annotations

import subprocess
import sys
import sysconfig

import pytest
from support.folders import ROOT

IMPORT_ALL = """
import importlib, pkgutil, sys
import rosidl_py_gen
for module in pkgutil.walk_packages(rosidl_py_gen.__path__, "rosidl_py_gen.", onerror=lambda _: None):
    if "ros_compat" not in module.name and not module.name.endswith("__main__"):
        try:
            importlib.import_module(module.name)
        except ImportError:  # an extra that is not installed
            continue
        assert not sys._is_gil_enabled(), module.name
"""


@pytest.mark.skipif(not sysconfig.get_config_var("Py_GIL_DISABLED"), reason="this Python has a GIL")
def test_modules_that_a_process_imports_do_not_enable_the_gil() -> None:
    done = subprocess.run([sys.executable, "-c", IMPORT_ALL], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
