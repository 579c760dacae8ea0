"""Compare encode and decode with other Python CDR libraries, in one process, interleaved.

Usage: ``python bench/codec.py [--seconds 0.15] [--markdown] [--generation]``

Prints microseconds a message and the peers' times as multiples of ours. The peers are what is installed of rosbags,
pycdr2 and mcap-ros2-support; "copy" is ``bytes(payload)`` of the encoded message. Compare times within one run only.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import math
import subprocess
import sys
import tempfile
import time
import timeit
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from rosidl_py_gen import Message, to_dict, type_name
from rosidl_py_gen.base.fieldtype import Arity
from rosidl_py_gen.base.names import RosName
from rosidl_py_gen.compiler.frontend.definition_text import DefinitionText
from rosidl_py_gen.compiler.frontend.search_path import SearchPath
from rosidl_py_gen.compiler.generate import LoadedInterfaces, generate

PACKAGES = ["sensor_msgs", "nav_msgs", "tf2_msgs", "visualization_msgs"]
BULK = ("Image 1080p", "PointCloud2 1 MB")
NOT_IN_MEANS = (*BULK, "Marker x10000")
ARRAYS = " as arrays"  # behind the name of a message whose sequences are structured arrays
Pair = tuple[Callable[[], Any], Callable[[], Any]]


@dataclass
class Row:
    """Result of a message and a direction: microseconds by library."""

    message: str
    direction: str
    micros: dict[str, float] = field(default_factory=dict)

    def ratio(self, peer: str) -> float:
        return self.micros[peer] / self.micros["ours"]


def messages() -> dict[str, Any]:
    """The messages of the table, filled with plausible values."""
    std, geometry, sensor, nav, tf2, visualization = (
        importlib.import_module(f"{name}.msg")
        for name in ("std_msgs", "geometry_msgs", "sensor_msgs", "nav_msgs", "tf2_msgs", "visualization_msgs")
    )
    time_type = type(std.Header().stamp)
    random = np.random.default_rng(1)

    def header(frame: str = "base_link") -> Any:
        return std.Header(stamp=time_type(1700000000, 123456789), frame_id=frame)

    def pose() -> Any:
        x, y, z, qx, qy, qz, qw = random.random(7).tolist()
        return geometry.Pose(geometry.Point(x, y, z), geometry.Quaternion(qx, qy, qz, qw))

    def twist() -> Any:
        a, b, c, d, e, f = random.random(6).tolist()
        return geometry.Twist(geometry.Vector3(a, b, c), geometry.Vector3(d, e, f))

    def stamped_transform(index: int) -> Any:
        value = pose()
        shift = geometry.Vector3(value.position.x, value.position.y, value.position.z)
        transform = geometry.Transform(shift, value.orientation)
        return geometry.TransformStamped(header("odom"), f"link_{index}", transform)

    points = [
        sensor.PointField(name=name, offset=4 * index, datatype=7, count=1) for index, name in enumerate("xyz")
    ] + [sensor.PointField(name="intensity", offset=12, datatype=7, count=1)]
    marker = visualization.Marker(
        header=header(),
        points=[geometry.Point(*row) for row in random.random((10_000, 3)).tolist()],
        colors=[std.ColorRGBA(*row) for row in random.random((10_000, 4)).tolist()],
    )
    return {
        "String 11 B": std.String(data="hello world"),
        "Twist": twist(),
        "PoseStamped": geometry.PoseStamped(header(), pose()),
        "TFMessage x10": tf2.TFMessage(transforms=[stamped_transform(index) for index in range(10)]),
        "JointState x12": sensor.JointState(
            header(), [f"joint_{index}" for index in range(12)], random.random(12), random.random(12), random.random(12)
        ),
        "Imu": sensor.Imu(
            header(),
            pose().orientation,
            random.random(9),
            twist().linear,
            random.random(9),
            twist().linear,
            random.random(9),
        ),
        "Odometry": nav.Odometry(
            header(),
            "base_link",
            geometry.PoseWithCovariance(pose(), random.random(36)),
            geometry.TwistWithCovariance(twist(), random.random(36)),
        ),
        "LaserScan x1080": sensor.LaserScan(
            header=header("laser"),
            angle_min=-1.5,
            angle_max=1.5,
            ranges=random.random(1080).astype(np.float32),
            intensities=random.random(1080).astype(np.float32),
        ),
        "PoseArray x1000": geometry.PoseArray(header(), [pose() for _ in range(1000)]),
        "Path x1000": nav.Path(header(), [geometry.PoseStamped(header(), pose()) for _ in range(1000)]),
        "Marker x10000": marker,
        "Image 1080p": sensor.Image(
            header=header("camera"),
            height=1080,
            width=1920,
            encoding="rgb8",
            step=5760,
            data=random.integers(0, 255, 1920 * 1080 * 3, np.uint8),
        ),
        "PointCloud2 1 MB": sensor.PointCloud2(
            header=header("lidar"),
            height=1,
            width=65536,
            fields=points,
            point_step=16,
            row_step=1 << 20,
            data=random.integers(0, 255, 1 << 20, np.uint8),
            is_dense=True,
        ),
    }


def with_arrays(table: dict[str, Any]) -> dict[str, tuple[Any, dict[str, bool]]]:
    """Each message with the arguments to decode it with, and once more with arrays where that makes a difference."""
    result: dict[str, tuple[Any, dict[str, bool]]] = {}
    for name, message in table.items():
        result[name] = message, {}
        held = type(message).decode(message.encode(), arrays=True)
        if any(isinstance(getattr(held, field.py_name), np.ndarray) for field in held._TYPE.fields if field.cls):
            result[name + ARRAYS] = held, {"arrays": True}
    return result


def measure(calls: dict[str, Callable[[], Any]], seconds: float) -> dict[str, float]:
    """Best microseconds of each call; the calls take turns so that a noisy moment hits all alike."""
    repeats = {}
    for name, call in calls.items():
        once = timeit.timeit(call, number=1) + 1e-7
        repeats[name] = max(1, int(seconds / 8 / max(once, timeit.timeit(call, number=3) / 3)))
    best = dict.fromkeys(calls, math.inf)
    for _ in range(8):
        for name, call in calls.items():
            best[name] = min(best[name], timeit.timeit(call, number=repeats[name]) / repeats[name])
    return {name: value * 1e6 for name, value in best.items()}


def rows(peers: list[Peer], seconds: float) -> list[Row]:
    table: list[Row] = []
    for name, (message, how) in with_arrays(messages()).items():
        payload = message.encode()
        copied = memoryview(bytearray(payload))
        encode: dict[str, Callable[[], Any]] = {"ours": message.encode}
        decode: dict[str, Callable[[], Any]] = {"ours": partial(type(message).decode, payload, **how)}
        for peer in [] if how else peers:
            pair = peer.pair(message, payload)
            if pair is not None:
                encode[peer.name], decode[peer.name] = pair
        encode["copy"] = decode["copy"] = partial(bytes, copied)
        for direction, calls in (("encode", encode), ("decode", decode)):
            table.append(Row(name, direction, measure(calls, seconds)))
            print(".", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return table


# ----------------------------------------------------------------------------------------------------- other libraries


@dataclass
class Peer:
    """A library by name; `make` gives its encode and decode calls for a message, or None if it cannot."""

    name: str
    make: Callable[[Message, bytes], Pair | None]

    def pair(self, message: Message, payload: bytes) -> Pair | None:
        return self.make(message, payload)


def available_peers() -> list[Peer]:
    """The peers that are installed. The last three are not in the test extra: install them by hand."""
    known: list[tuple[str, str, Callable[[Message, bytes], Pair | None]]] = [
        ("rosbags", "rosbags", _rosbags),
        ("pycdr2", "pycdr2", _pycdr2),
        ("mcap_ros2", "mcap-ros2-support", _mcap),
        ("mcap_ros2_support_fast", "mcap-ros2-support-fast", _mcap_fast),
        ("cyclonedds_idl", "ros2-pyterfaces[cyclone]", partial(_pyterfaces, "cyclone")),
        ("cydr", "ros2-pyterfaces[cydr]", partial(_pyterfaces, "cydr")),  # compiles C at a type's first use
    ]
    return [Peer(name, make) for module, name, make in known if importlib.util.find_spec(module)]


_stores: list[Any] = []


def _rosbags(message: Message, payload: bytes) -> Pair:
    from rosbags.typesys import Stores, get_typestore

    if not _stores:
        _stores.append(get_typestore(Stores.ROS2_JAZZY))
    store = _stores[0]
    name = type_name(message)
    value = store.deserialize_cdr(payload, name)
    assert bytes(store.serialize_cdr(value, name))[: len(payload)] == payload
    return lambda: store.serialize_cdr(value, name), lambda: store.deserialize_cdr(payload, name)


def _pycdr2(message: Message, payload: bytes) -> Pair | None:
    cls = _pycdr2_class(type(message), {})
    value = cls.deserialize(payload)
    assert value.serialize() == payload
    return value.serialize, lambda: cls.deserialize(payload)


def _pycdr2_class(cls: type[Message], known: dict[type[Message], Any]) -> Any:
    from pycdr2 import IdlStruct
    from pycdr2 import types as idl

    if cls in known:
        return known[cls]
    scalars = {"string": str, "bool": bool, "byte": idl.uint8, "char": idl.uint8}
    members = []
    for member in cls._TYPE.fields:
        base = _pycdr2_class(member.cls, known) if member.cls else scalars.get(member.type.base)
        base = base or getattr(idl, member.type.base)
        if member.type.arity is Arity.ARRAY:
            base = idl.array[base, member.type.capacity]
        elif member.type.arity is not Arity.SCALAR:
            base = idl.sequence[base]
        members.append((member.ros_name, base))

    known[cls] = dataclass(type(cls.__name__, (IdlStruct,), {"__annotations__": dict(members)}, typename=cls.__name__))

    return known[cls]


def _mcap(message: Message, payload: bytes) -> Pair:
    from mcap_ros2._dynamic import generate_dynamic, serialize_dynamic

    name = RosName.parse(type_name(message))
    text = _text(name)
    short = f"{name.package}/{name.name}"
    decoder = next(value for key, value in generate_dynamic(short, text).items() if key in (short, str(name)))
    encoder = next(value for key, value in serialize_dynamic(short, text).items() if key in (short, str(name)))
    value = _lists(to_dict(message))
    assert encoder(value) == payload
    return lambda: encoder(value), lambda: decoder(payload)


def _mcap_fast(message: Message, payload: bytes) -> Pair:
    from mcap_ros2_support_fast import DecoderFactory, ROS2EncoderFactory

    name = RosName.parse(type_name(message))
    schema = SimpleNamespace(id=1, name=str(name), encoding="ros2msg", data=_text(name).encode())
    decoder, encoder = DecoderFactory().decoder_for("cdr", schema), ROS2EncoderFactory().encoder_for(schema)
    assert decoder is not None and encoder is not None
    value = to_dict(message)  # of what it decodes itself, it does not encode arrays of floats
    assert bytes(encoder(value)) == payload
    return lambda: encoder(value), lambda: decoder(payload)


def _pyterfaces(backend: str, message: Message, payload: bytes) -> Pair | None:
    package, kind, name = RosName.parse(type_name(message))
    try:
        cls = getattr(importlib.import_module(f"ros2_pyterfaces.{backend}.{package}.{kind}"), name)
    except ModuleNotFoundError:
        return None  # it has no tf2_msgs
    if hasattr(cls, "__unsupported_reason__"):
        return None  # cydr has no sequences of messages; such a class is empty
    value = cls.deserialize(payload)
    assert bytes(value.serialize())[: len(payload)] == payload
    return value.serialize, lambda: cls.deserialize(payload)


def _text(name: RosName) -> str:
    library, _ = LoadedInterfaces.load(SearchPath.scan(), [str(name)])
    return DefinitionText(library, name).full


def _lists(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value


# -------------------------------------------------------------------------------------------------------------- output


def geometric_mean(values: list[float]) -> float:
    return math.exp(sum(map(math.log, values)) / len(values))


def show(table: list[Row], peers: list[str], markdown: bool) -> None:
    columns = ["message", "", "ours us", *(f"{peer}" for peer in peers), "copy us"]
    lines = []
    for row in table:
        cells = [row.message, row.direction, f"{row.micros['ours']:.2f}"]
        cells += [f"{row.ratio(peer):.1f}x" if peer in row.micros else "-" for peer in peers]
        lines.append([*cells, f"{row.micros['copy']:.2f}"])
    if markdown:
        print("| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
        for cells in lines:
            print("| " + " | ".join(cells) + " |")
    else:
        widths = [max(len(row[index]) for row in [columns, *lines]) for index in range(len(columns))]
        for cells in [columns, *lines]:
            print("  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)))
    print()
    for direction in ("encode", "decode"):
        chosen = [row for row in table if row.direction == direction and row.message not in NOT_IN_MEANS]
        for peer in peers:
            ratios = [row.ratio(peer) for row in chosen if peer in row.micros]
            if ratios:
                mean, least = geometric_mean(ratios), min(ratios)
                print(f"{direction} against {peer}: geometric mean {mean:.1f}x, least {least:.1f}x")
    for row in table:
        if row.message in BULK:
            versus = row.micros["ours"] / row.micros["copy"]
            print(f"{row.direction} {row.message}: {row.micros['ours']:.1f} us, {versus:.2f} of a copy")


def generation(folder: Path) -> None:
    """Time and memory of generating everything cold, and of importing a package, each in a fresh process."""
    code = (
        "import resource, sys, time; start = time.perf_counter(); from rosidl_py_gen.generator_cli import main\n"
        f"try: main(['--out', {str(folder / 'all')!r}])\n"
        "except SystemExit: pass\n"
        "peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024\n"
        "print(f'generate every bundled package: {time.perf_counter() - start:.2f} s, peak {peak:.0f} MB')"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    code = (
        "import numpy, sys, time; start = time.perf_counter(); import sensor_msgs.msg\n"
        "print(f'import sensor_msgs.msg on top of numpy: {(time.perf_counter() - start) * 1e3:.1f} ms')"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=folder / "all")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=0.15, help="time spent on each cell")
    parser.add_argument("--markdown", action="store_true", help="print the table as Markdown")
    parser.add_argument("--generation", action="store_true", help="measure the compiler and imports instead")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.generation:
            generation(folder)
            return
        generate(SearchPath.scan(), PACKAGES, folder)
        sys.path.insert(0, name)
        start = time.perf_counter()
        peers = available_peers()
        table = rows(peers, arguments.seconds)
        print(f"CPython {sys.version.split()[0]}, numpy {np.__version__}, {time.perf_counter() - start:.0f} s")
        show(table, [peer.name for peer in peers], arguments.markdown)


if __name__ == "__main__":
    main()
