"""sensor_msgs_py, tf2_*_msgs, tf_transformations, cv_bridge and image_geometry return what the real ones return.

``programs`` is run here, ``recorded`` has its output under the real packages of Jazzy (cv_bridge: its Python code and
the rules of its C++ code, with OpenCV 4.10; tf_transformations 1.1.1 with transforms3d 0.4.2), in an environment with
ros-jazzy-sensor-msgs: ``python programs/clouds.py > recorded/clouds.jsonl``. image_geometry 3.4.0 needs only its Python
files, OpenCV 4.10 and messages.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from support.compare_json_lines import unlike
from support.environments import environment
from support.interface_packages import write
from support.program_processes import run

pytestmark = pytest.mark.real_time("programs are processes")
HERE = Path(__file__).parent


@pytest.mark.parametrize("name", ["cameras", "clouds", "geometry", "images", "transformations"])
def test_companion_packages_return_recorded_results_of_real_packages(name: str) -> None:
    expected = (HERE / "recorded" / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()
    packages = ""
    if name == "cameras":
        python = environment("opencv", ["opencv-python-headless==4.10.0.84"])
        packages = str(next(python.parents[1].glob("[Ll]ib/**/site-packages")))
    done = run(HERE / "programs" / f"{name}.py", PYTHONPATH=packages)
    assert done.returncode == 0, done.stderr
    found = done.stdout.splitlines()
    assert [(expected[at], found[at]) for at in unlike(expected, found)] == []


RECTIFIED = """
from image_geometry import PinholeCameraModel
from sensor_msgs.msg import CameraInfo

camera = PinholeCameraModel()
camera.fromCameraInfo(CameraInfo(width=4, height=3, p=[2.0, 0.0, 1.0, 0.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]))
print(*camera.project3dToPixel((1, 2, 4)))
camera.rectifyPoint((0, 0))
"""


def test_camera_models_need_opencv_only_to_rectify(tmp_path: Path) -> None:
    write(tmp_path, {"program.py": RECTIFIED, "cv2.py": "raise ModuleNotFoundError('hidden', name='cv2')"})
    found = run("program.py", cwd=tmp_path)
    assert found.stdout == "1.5 2.0\n"
    assert found.stderr.endswith("install opencv-python-headless\n"), found.stderr


def test_comparison_detects_different_results() -> None:
    pixels = '{{"shape": [1], "dtype": "uint8", "pixels": "{}", "off": 1}}'
    same = ["1.0", "[NaN]", pixels.format("05"), '"TypeError"']
    assert unlike(same, ["1.0000000000001", "[NaN]", pixels.format("06"), '"TypeError"']) == []
    assert unlike(same, ["1.1", "[0.0]", pixels.format("07"), '"KeyError"']) == [0, 1, 2, 3]


def test_tf_transformations_without_transforms3d_names_the_extra(tmp_path: Path) -> None:
    hidden = "raise ModuleNotFoundError('hidden', name='transforms3d')"
    write(tmp_path, {"program.py": "import tf_transformations\n", "transforms3d.py": hidden})
    found = run("program.py", cwd=tmp_path)
    assert "ExtraMissingError: this needs transforms3d, which is not installed: pip install" in found.stderr
    assert "[transformations]" in found.stderr
