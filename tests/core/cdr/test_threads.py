"""Codecs, class information and structured arrays that several threads use for the first time at once."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from support.folders import ROOT
from support.inner_state import type_fields
from support.parallel_threads import in_threads

import rosidl_py_gen
from rosidl_py_gen import compile_definition, decode, dtype, encode, from_dict, records, to_dict
from rosidl_py_gen.cdr.type_queries import type_description

_SEPARATOR = "=" * 80
_CLOUD = f"""string name
Point[] points
Point[3] corners
float32[] weights
uint8[] data
bool is_dense
{_SEPARATOR}
MSG: threads_msgs/Point
bool valid
float64 x
float32 y
uint16 number
"""


def cloud(cls: Any, number: int) -> Any:
    points = [{"valid": True, "x": number + k / 4, "y": k / 2, "number": k} for k in range(5)]
    values = {"name": f"cloud {number}", "points": points, "corners": points[:3], "weights": [0.5, number]}
    return from_dict(cls, {**values, "data": list(range(number + 1)), "is_dense": True})


@pytest.mark.parametrize("attempt", range(5))
def test_first_use_of_a_class_in_eight_threads_yields_equal_bytes_and_arrays(attempt: int) -> None:
    # Another constant for each attempt, so that the classes and all their caches are new.
    definition = f"uint8 ATTEMPT={attempt}\n{_CLOUD}"

    def work(number: int) -> tuple[type, bytes, bytes, str, Any]:
        cls = compile_definition("threads_msgs/msg/Cloud", definition)
        point: Any = type_fields(cls)[1].cls
        message = cloud(cls, number % 2)
        data = encode(message)
        assert decode(cls, data) == message and to_dict(decode(cls, data)) == to_dict(message)
        structured = decode(cls, data, arrays=True)
        assert isinstance(structured.points, np.ndarray) and encode(structured) == data
        assert records(message.points).tobytes() == structured.points.tobytes()
        return cls, data, structured.points.tobytes(), json.dumps(type_description(cls)), dtype(point)

    results = in_threads(work)
    assert len({cls for cls, *_ in results}) == 1
    assert len({(data, points, text) for _, data, points, text, _ in results}) == 2  # of even and of odd threads
    assert all(one == results[0][4] for *_, one in results)


def test_eight_threads_encode_and_decode_with_one_class() -> None:
    cls = compile_definition("threads_msgs/msg/Cloud", _CLOUD)
    messages = [cloud(cls, number) for number in range(8)]
    encoded = [encode(message) for message in messages]

    def work(number: int) -> None:
        for count in range(100):
            index = (number + count) % len(messages)
            assert encode(messages[index]) == encoded[index]  # a message that other threads encode as well
            decoded = decode(cls, encoded[index], copy=bool(count % 2), arrays=count % 3 == 0)
            assert encode(decoded) == encoded[index]

    in_threads(work)


FIRST_NUMPY = """
import sys
sys.setswitchinterval(1e-6)
from concurrent.futures import ThreadPoolExecutor
import threading
from rosidl_py_gen.base import lazy_numpy as np
from rosidl_py_gen.cdr import support
assert "numpy" not in sys.modules, "the first use of numpy is not in the threads"
barrier = threading.Barrier(8)

def work(number):
    barrier.wait()
    array = np.arange(number) if number % 2 else support.frombuffer(bytes(number), support.UINT8)
    return array.size, str(support.FLOAT64), isinstance(array, support.ndarray), isinstance(array, np.ndarray)

with ThreadPoolExecutor(8) as pool:
    print(list(pool.map(work, range(8))) == [(number, "float64", True, True) for number in range(8)])
"""


@pytest.mark.slow
def test_numpy_is_imported_by_eight_threads_of_a_new_process_at_once() -> None:
    command = [sys.executable, "-c", FIRST_NUMPY]
    for _ in range(3):
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout == "True\n"


def test_public_names_are_the_same_objects_in_eight_threads() -> None:
    def work(_: int) -> list[object]:
        return [getattr(rosidl_py_gen, name) for name in rosidl_py_gen.__all__ if name != "bags"]

    first, *others = in_threads(work)
    assert all(all(a is b for a, b in zip(first, other, strict=True)) for other in others)
