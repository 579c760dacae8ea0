"""sensor_msgs_py, tf2_sensor_msgs, tf2_geometry_msgs, tf_transformations and cv_bridge answer as the real ones do.

``asked`` has programs, ``recorded`` what they print under the real packages, of Jazzy (cv_bridge: its Python, and what
its C++ decides, over OpenCV 4.10; tf_transformations 1.1.1 with transforms3d 0.4.2), in an environment that has
ros-jazzy-sensor-msgs: ``python asked/clouds.py > recorded/clouds.jsonl``.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from companion_answers import unlike
from run_programs import run

pytestmark = pytest.mark.real_time("programs are processes")
HERE = Path(__file__).parent


@pytest.mark.parametrize("name", ["clouds", "geometry", "images", "transformations"])
def test_every_answer_is_that_of_the_real_package(name: str) -> None:
    expected = (HERE / "recorded" / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
    done = run(HERE / "asked" / f"{name}.py")
    assert done.returncode == 0, done.stderr
    found = done.stdout.splitlines()
    assert [(expected[at], found[at]) for at in unlike(expected, found)] == []


def test_an_answer_that_is_another_one_is_told() -> None:
    pixels = '{{"shape": [1], "dtype": "uint8", "pixels": "{}", "off": 1}}'
    same = ["1.0", "[NaN]", pixels.format("05"), '"TypeError"']
    assert unlike(same, ["1.0000000000001", "[NaN]", pixels.format("06"), '"TypeError"']) == []
    assert unlike(same, ["1.1", "[0.0]", pixels.format("07"), '"KeyError"']) == [0, 1, 2, 3]
