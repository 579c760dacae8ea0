"""Function that returns the prefixes in which packages are installed."""

import os

from ament_index_python.constants import AMENT_PREFIX_PATH_ENV_VAR


def get_search_paths() -> list[str]:
    """Return the folders in AMENT_PREFIX_PATH that exist.

    Raises:
        EnvironmentError: the variable is not set or empty; packages of a workspace are found nevertheless.
    """
    value = os.environ.get(AMENT_PREFIX_PATH_ENV_VAR)
    if not value:
        raise OSError(f"Environment variable '{AMENT_PREFIX_PATH_ENV_VAR}' is not set or empty")
    return [path for path in value.split(os.pathsep) if path and os.path.exists(path)]
