"""Packages and their files: installed in a prefix of AMENT_PREFIX_PATH, or as sources in the workspace."""

from ament_index_python.constants import RESOURCE_INDEX_SUBFOLDER as RESOURCE_INDEX_SUBFOLDER
from ament_index_python.packages import PackageNotFoundError as PackageNotFoundError
from ament_index_python.packages import get_package_prefix as get_package_prefix
from ament_index_python.packages import get_package_share_directory as get_package_share_directory
from ament_index_python.packages import get_package_share_path as get_package_share_path
from ament_index_python.packages import get_packages_with_prefixes as get_packages_with_prefixes
from ament_index_python.resources import InvalidResourceNameError as InvalidResourceNameError
from ament_index_python.resources import InvalidResourceTypeNameError as InvalidResourceTypeNameError
from ament_index_python.resources import get_resource as get_resource
from ament_index_python.resources import get_resource_types as get_resource_types
from ament_index_python.resources import get_resources as get_resources
from ament_index_python.resources import has_resource as has_resource
from ament_index_python.search_paths import get_search_paths as get_search_paths

__all__ = [
    "RESOURCE_INDEX_SUBFOLDER",
    "InvalidResourceNameError",
    "InvalidResourceTypeNameError",
    "PackageNotFoundError",
    "get_package_prefix",
    "get_package_share_directory",
    "get_package_share_path",
    "get_packages_with_prefixes",
    "get_resource",
    "get_resource_types",
    "get_resources",
    "get_search_paths",
    "has_resource",
]
