"""A row of `PRIMITIVES` is all that a new type of fields needs at run time, also a type that `array.array` lacks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from support.folders import ROOT
from support.interface_packages import write

AFTER = '"float64": Primitive("d", 8, 11, "float64", "float", "double", "d", 1.7976931348623157e308),\n'
ROW = '"float16": Primitive("e", 2, 40, "float16", "float", "half", "f", 65504.0),\n'
PROGRAM = f"""
import struct
import sys
from array import array
from importlib.util import find_spec, module_from_spec

import numpy as np

spec = find_spec("rosidl_py_gen.base.fieldtype")
module = sys.modules[spec.name] = module_from_spec(spec)
source = spec.loader.get_source(spec.name)
assert source.count({AFTER!r}) == 1
exec(source.replace({AFTER!r}, {AFTER + ROW!r}), vars(module))

from rosidl_py_gen import compile_definition, install_import_hook
from rosidl_py_gen.errors import EncodeError

text = "float16 one\\nfloat16[] many\\nfloat16[2] two\\nfloat16 LIMIT=1.5"
native = compile_definition("a_msgs/msg/Halves", text)
values = native(one=0.1, many=[1.5, 2.5], two=np.float32([3, 4]))
data = values.encode()
assert data == b"\\0\\1\\0\\0" + struct.pack("<e2xI2e2e", 0.1, 2, 1.5, 2.5, 3, 4) and native.LIMIT == 1.5
assert native.decode(data).many.dtype == native.decode(data).two.dtype == np.float16
assert native.decode(data).one == np.float16(0.1) and native.decode(data).many.tolist() == [1.5, 2.5]
try:
    native(many=[65520.0]).encode()
except EncodeError as error:
    assert "many[0]: expected float that fits float16" in str(error), error
else:
    raise AssertionError

with install_import_hook(message_api="rclpy", path=sys.argv[1], override_installed=True):
    from half_msgs.msg import Halves

    message = Halves(one=0.1, many=[1.5, 2.5], two=[3.0, 4.0], check_fields=True)
    assert message.many == array("f", [1.5, 2.5]) and message.two.dtype == np.float16
    assert message.encode() == data
    assert Halves.decode(data).many == message.many and Halves.decode(data).many.typecode == "f"
    assert Halves(many=np.float16([1.5, 2.5])).many == message.many
    message.many = array("f", [2.5])
    for wrong in (array("d", [2.5]), [65505.0]):
        try:
            message.many = wrong
        except AssertionError as error:
            assert "'many'" in str(error)
        else:
            raise AssertionError(wrong)
    for damaged in (data[:-1], data[:12], data[:8] + b"\\xff\\xff\\xff\\x7f" + data[12:]):
        try:
            Halves.decode(damaged)
        except Exception as error:
            assert type(error).__name__ == "DecodeError", error
        else:
            raise AssertionError(damaged)
"""


def test_a_row_is_enough_for_a_type_that_arrays_lack(tmp_path: Path) -> None:
    files = {"half_msgs/package.xml": "<package><name>half_msgs</name></package>"}
    files["half_msgs/msg/Halves.msg"] = "float16 one\nfloat16[] many\nfloat16[2] two\nfloat16 LIMIT=1.5\n"
    folder = write(tmp_path, files)
    command = [sys.executable, "-c", PROGRAM, str(folder)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")
