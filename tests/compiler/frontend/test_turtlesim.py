"""The definitions of turtlesim are those of its repository: rosidl computed these hashes of the files there."""

from __future__ import annotations

import pytest

from rosidl_py_gen.base.resources import interfaces_dir
from rosidl_py_gen.compiler.frontend.registry import InterfaceRegistry
from rosidl_py_gen.compiler.frontend.search_path import scan_search_path

HASHES = {
    "turtlesim/action/RotateAbsolute": "RIHS01_08ba6dd83d976f1cb548edd1f75f16cf30cca624ce1410b6ce77f44b8a3c2895",
    "turtlesim/msg/Color": "RIHS01_74492579ec0d734707aede0e742ab76c55ac50d3ff917381e5163624cb657fe5",
    "turtlesim/msg/Pose": "RIHS01_739beba26bcba6920404ba722b7b8321348512f92ea5be235c47251940dd8aa9",
    "turtlesim/srv/Kill": "RIHS01_81c7c9131a0802f384e515fbd04867f8da57abaa83ee3a0ec76e39091e54bbc3",
    "turtlesim/srv/SetPen": "RIHS01_45ca246c7258172a89a58856037d6b4489eb46a18f1d8ee1988c018ef46fcfce",
    "turtlesim/srv/Spawn": "RIHS01_a71be24836f772debd6187dc8618cc47700d2602c7a3e2228bad67a8f5fd27b4",
    "turtlesim/srv/TeleportAbsolute": "RIHS01_139aa0f215e25dc085067f070adb3ef65cf3c92d201f5cb750d51ca9322166b6",
    "turtlesim/srv/TeleportRelative": "RIHS01_6e9e54cb05e1a789f982bf8c93d27fc899cee099746c4ea8c7cb64e8a90297d6",
}
"""By rosidl_adapter and rosidl_generator_type_description 4.6.6, of github.com/ros/ros_tutorials 1.8.2. The hash of a
service or action covers all types that are derived of it."""


@pytest.fixture(scope="module")
def library() -> InterfaceRegistry:
    return InterfaceRegistry(scan_search_path([interfaces_dir()], ament="", bundled=False))


@pytest.mark.parametrize("name", HASHES)
def test_a_type_has_rosidl_s_hash(library: InterfaceRegistry, name: str) -> None:
    assert library.type_hash(name) == HASHES[name]


def test_these_are_all_files(library: InterfaceRegistry) -> None:
    assert {str(name) for name in library.search.packages["turtlesim"].files} == set(HASHES)
