"""Find the source tree of Cyclone DDS, and the version that its CMakeLists.txt declares, which is the wheel's.

The tree is named by an environment variable: settings of the build (`-C`) do not reach whoever gives a wheel its
version. CMakeLists.txt beside this file reads the same variable.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

VARIABLE = "CYCLONEDDS_SOURCE"
DECLARED = re.compile(r"^\s*project\s*\(\s*CycloneDDS\s+VERSION\s+([0-9]+(?:\.[0-9]+)+)", re.MULTILINE | re.IGNORECASE)


class SourceTreeError(Exception):
    """Whoever builds the wheel has to name a source tree of Cyclone DDS."""


def version() -> str:
    """The version of the tree that the environment names.

    Raises:
        SourceTreeError: no tree is named, it is not there, or it is something else.
    """
    named = os.environ.get(VARIABLE)
    if not named:
        raise SourceTreeError(f"{VARIABLE} is not set; it has to name a source tree of Cyclone DDS, by its whole path")
    if not os.path.isabs(named):
        raise SourceTreeError(f"{VARIABLE}={named}: expected a whole path; builds run in folders of their own")
    file = Path(named) / "CMakeLists.txt"
    if not file.is_file():
        raise SourceTreeError(f"{VARIABLE}={named}: expected a source tree of Cyclone DDS, found no CMakeLists.txt")
    declared = DECLARED.search(file.read_text(encoding="utf-8"))
    if declared is None:
        raise SourceTreeError(f'{file}: expected "project(CycloneDDS VERSION ...", found nothing of the kind')
    return declared[1]


def dynamic_metadata(settings: Mapping[str, object], project: Mapping[str, object]) -> dict[str, str]:
    """What scikit-build-core asks for."""
    return {"version": version()}
