"""Generated packages as a whole: the same bytes every time, clean for ruff and mypy, lazy, and one class per type."""

from __future__ import annotations

import hashlib
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from support.definition_strategies import World, worlds
from support.example_counts import examples
from support.interface_packages import REPOSITORY, TEST_INTERFACES, assert_clean, importable, mypy, python, run, write

from rosidl_py_gen import type_hash
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import RUNTIME_PACKAGES, generate, regenerate_msgs


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """All bundled packages and the test interfaces."""
    out = tmp_path_factory.mktemp("everything") / "out"
    generate(SearchPath.scan([TEST_INTERFACES], ament=""), [], out)
    with importable(out):
        yield out


def digest(folder: Path) -> str:
    state = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and "__pycache__" not in path.parts:
            state.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes() + b"\0")
    return state.hexdigest()


# --- the same bytes ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_generated_bytes_do_not_depend_on_hash_order_folder_or_environment(everything: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from rosidl_py_gen.compiler.generate import generate;"
        "from rosidl_py_gen.compiler.frontend.search_path import SearchPath;"
        f"generate(SearchPath.scan([{str(TEST_INTERFACES)!r}], ament=''), [], Path('out'))"
    )
    python(code, cwd=tmp_path, PYTHONHASHSEED="1", LC_ALL="C", TZ="Pacific/Kiritimati")
    assert digest(tmp_path / "out") == digest(everything)


# --- clean ------------------------------------------------------------------------------------------------------------


def test_all_packages_are_formatted_and_clean(everything: Path) -> None:
    assert_clean(everything)


@pytest.mark.slow
def test_all_packages_pass_strict_mypy(everything: Path, tmp_path: Path) -> None:
    packages = sorted(path.name for path in everything.iterdir() if (path / "__init__.py").is_file())
    mypy(everything, *[part for name in packages for part in ("-p", name)])


def test_a_users_program_passes_strict_mypy(everything: Path, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "from builtin_interfaces.msg import Time\n"
        "from example_interfaces.action import Fibonacci\n"
        "from example_interfaces.srv import AddTwoInts, AddTwoInts_Request\n"
        "from geometry_msgs.msg import Point, PoseStamped\n"
        "import numpy as np\n"
        "from sensor_msgs.msg import Image, JointState, PointField\n"
        "from std_msgs.msg import Header\n"
        "import rosidl_py_gen as ros\n"
        "from rosidl_py_gen.msgs.builtin_interfaces.msg import Time as OwnTime\n"
        "\n"
        "pose = PoseStamped(header=Header(stamp=OwnTime(sec=1)))\n"
        "pose.header.stamp = Time(sec=3)\n"
        "pose.pose.position = Point(1.0, 2.0, z=3.0)\n"
        "again: PoseStamped = PoseStamped.decode(pose.encode())\n"
        "image: Image = ros.decode(Image, ros.encode(Image(data=b'ab')), copy=True)\n"
        "state = JointState(name=['a'], position=[1, 2.0], velocity=(), effort=np.zeros(2))\n"
        "peak: float = state.position.max().item()\n"
        "size: int = image.data.nbytes + PointField.FLOAT32\n"
        "request: AddTwoInts_Request = AddTwoInts.Request(a=1, b=2)\n"
        "total: int = AddTwoInts.Response(sum=3).sum\n"
        "goal = Fibonacci.SendGoal.Request(goal=Fibonacci.Goal(order=3))\n"
        "order: int = goal.goal.order\n"
        "name: str = ros.type_name(again) + ros.type_hash(Fibonacci)\n"
    )
    mypy(everything, str(program))


def test_wrong_programs_do_not_pass_mypy(everything: Path, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "from geometry_msgs.msg import Point\nPoint(x='a')\nPoint().w\nfrom geometry_msgs.msg import Nothing\n"
        "from sensor_msgs.msg import JointState\nJointState(position=['a'])\n"
    )
    with pytest.raises(AssertionError) as caught:
        mypy(everything, str(program))
    for line, code in ((2, "arg-type"), (3, "attr-defined"), (4, "attr-defined"), (6, "list-item")):
        assert any(f"program.py:{line}:" in one and code in one for one in str(caught.value).splitlines())


@pytest.mark.hypothesis  # the plugin marks only tests that are @given themselves
def test_random_definitions_become_clean_code(tmp_path: Path) -> None:
    files: dict[str, str] = {}

    @settings(
        max_examples=examples(150),
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(worlds())
    def collect(world: World) -> None:  # one run of ruff for all of them
        files.update({f"{name}.msg": text for name, text in world.texts})

    collect()
    run(write(tmp_path / "in", files), tmp_path / "out")
    assert_clean(tmp_path / "out")
    for path in (tmp_path / "out").rglob("*.py"):
        compile(path.read_text(encoding="utf-8"), str(path), "exec")


# --- cost of importing ------------------------------------------------------------------------------------------------


def loaded(out: Path, code: str) -> set[str]:
    program = f"import sys; sys.path.insert(0, {str(out)!r})\n{code}\nprint(*sys.modules)"
    return set(python(program).split())


def test_importing_a_package_loads_no_message(everything: Path) -> None:
    modules = loaded(everything, "import sensor_msgs.msg, nav_msgs.srv, example_interfaces.action")
    assert not [name for name in modules if name.startswith(("sensor_msgs.msg._", "nav_msgs.srv._", "std_msgs"))]
    assert "numpy" not in modules


def test_using_a_message_loads_only_its_module_and_dependencies(everything: Path) -> None:
    modules = loaded(everything, "from sensor_msgs.msg import Imu")
    assert {"sensor_msgs.msg._imu", "std_msgs.msg._header", "geometry_msgs.msg._vector3"} <= modules
    assert "sensor_msgs.msg._image" not in modules


def test_loading_compiler_modules_does_not_load_jinja2() -> None:
    modules = "rosidl_py_gen.compiler.generate, rosidl_py_gen.type_loading.class_lookup"
    found = python(f"import sys, {modules}; print('jinja2' in sys.modules)")
    assert found == "False\n"


def test_load_compiler_loads_all_modules_needed_to_make_a_class() -> None:
    program = """
import sys
from rosidl_py_gen.type_loading.class_lookup import get_message, load_compiler
load_compiler()
ahead = set(sys.modules)
get_message("sensor_msgs/msg/Imu")
print(*sorted(set(sys.modules) - ahead))
"""
    later = python(program).split()
    generated = ("rosidl_py_gen_memory", "rosidl_py_gen.msgs", "rosidl_py_gen.cdr.", "numpy.")  # and what it uses
    assert "rosidl_py_gen_memory.w1.sensor_msgs.msg._imu" in later
    assert [name for name in later if not name.startswith(generated)] == []


def test_generated_packages_load_only_codec_modules_and_numpy(everything: Path) -> None:
    code = (
        "from sensor_msgs.msg import PointCloud2\nfrom nav_msgs.srv import GetPlan\n"
        "from example_interfaces.action import Fibonacci\n"
        "PointCloud2.decode(PointCloud2().encode()); GetPlan.Response().encode(); "
        "Fibonacci.Goal().encode(); repr(PointCloud2())"
    )
    modules = loaded(everything, code)
    assert "numpy" in modules
    assert not {"lark", "jinja2", "click", "cyclonedds", "yaml", "typing_extensions"} & modules
    ours = {name for name in modules if name.startswith("rosidl_py_gen.")}
    names = ("cdr", "errors", "base.names", "base.fieldtype", "msgs")
    middle = tuple(f"rosidl_py_gen.{name}" for name in names)
    assert {name for name in ours if not name.startswith(middle)} == {
        "rosidl_py_gen.base",
        "rosidl_py_gen.base.lazy_numpy",
    }


def test_every_public_name_is_a_class_and_listed_by_dir(everything: Path) -> None:
    for path in sorted(everything.glob("*/*/__init__.py")):
        package = importlib.import_module(".".join(path.parent.relative_to(everything).parts))
        assert package.__all__
        for name in package.__all__:
            assert isinstance(getattr(package, name), type)
            assert name in dir(package)


# --- one class per type -----------------------------------------------------------------------------------------------


def test_packages_of_the_runtime_are_generated_with_its_own_classes(everything: Path) -> None:
    for package in RUNTIME_PACKAGES:
        for path in sorted((everything / package).glob("*/__init__.py")):
            kind = path.parent.name
            generated = importlib.import_module(f"{package}.{kind}")
            own = importlib.import_module(f"rosidl_py_gen.msgs.{package}.{kind}")
            for name in generated.__all__:
                assert getattr(generated, name) is getattr(own, name)


DIFFERENT = [
    ("int32 sec\nuint32 nanosec", True),
    ("# other comments\n\nint32   sec # [s]\nuint32 nanosec\n", True),
    ("int32 sec\nuint32 nanosec\nuint8 EXTRA=1", False),  # constants are not in the hash
    ("int32 sec 5\nuint32 nanosec", False),  # nor are defaults
    ("int32 sec\nuint32 nsec", False),
    ("int32 sec", False),
]


@pytest.mark.parametrize(("text", "same"), DIFFERENT)
def test_class_of_the_runtime_is_reused_only_for_an_identical_definition(tmp_path: Path, text: str, same: bool) -> None:
    files = {"builtin_interfaces/msg/Time.msg": text, "a_msgs/msg/Stamped.msg": "builtin_interfaces/Time stamp"}
    run(write(tmp_path / "in", files), tmp_path / "out", ["a_msgs"])
    before = {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] == "builtin_interfaces"}
    try:
        with importable(tmp_path / "out"):
            time = importlib.import_module("builtin_interfaces.msg").Time
            own = importlib.import_module("rosidl_py_gen.msgs.builtin_interfaces.msg").Time
            assert (time is own) == same
            stamped = importlib.import_module("a_msgs.msg").Stamped
            assert type(stamped().stamp) is time
            if "EXTRA" in text:
                assert time.EXTRA == 1
                assert type_hash(time) == type_hash(own)
    finally:
        sys.modules.update(before)


@pytest.mark.slow
def test_committed_msgs_equal_regenerated_ones() -> None:
    changes = regenerate_msgs(REPOSITORY / "rosidl_py_gen" / "msgs", dry=True)
    assert (changes.written, changes.removed) == ((), ())
