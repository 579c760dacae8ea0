"""Values of scalars, tags and lists in parameter files, and in text that rclpy reads with PyYAML."""
# ruff: noqa
# fmt: off

import math
import pathlib
import tempfile
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value, parameter_dict_from_yaml_file, parameter_value_to_python

folder = pathlib.Path(tempfile.mkdtemp())


def loaded(text):
    """Return type and value of a parameter with this text in a file; "refused" when the program ends."""
    file = folder / "one.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    p: {text}\n")
    context = rclpy.Context()
    try:
        context.init(args=["--ros-args", "--params-file", str(file)])
        node = Node("n", context=context, automatically_declare_parameters_from_overrides=True)
        found = node.get_parameter("p")
        return found.type_.name, [plain(one) for one in found.value] if isinstance(found.value, (list, tuple)) else plain(found.value)
    except Exception:
        return "refused"
    finally:
        context.try_shutdown()


def plain(value):
    return "nan" if isinstance(value, float) and math.isnan(value) else value


def read(text):
    """Return the value by rclpy's function over PyYAML; a refused text, or one of another type, is returned as text."""
    try:
        value = parameter_value_to_python(get_parameter_value(text))
    except Exception:
        return "text"
    if isinstance(value, list):
        return [plain(one) for one in value]
    return (type(value).__name__, plain(value)) if type(value) in (bool, int, float, str) and value != text else "text"


def of_file(text):
    """Return the value by rclpy's function for files."""
    file = folder / "two.yaml"
    file.write_text(f"/n:\n  ros__parameters:\n    p: {text}\n")
    try:
        value = parameter_value_to_python(parameter_dict_from_yaml_file(str(file))["p"].value)
    except Exception:
        return "refused"
    return [plain(one) for one in value] if isinstance(value, list) else (type(value).__name__, plain(value))


SCALARS = """true True TRUE false False FALSE yes Yes YES no No NO on On ON off Off OFF y Y n N tRue null Null NULL ~ none None
0 1 -1 +1 007 08 010 0o17 0x1F 0X1f -0x1F 0b101 1_000 1:30 9223372036854775807 9223372036854775808 -9223372036854775808 -9223372036854775809
0.0 1.0 1. .5 -.5 +1.5 1e3 1E3 1e+3 1e-3 1.5e3 1e400 -1e400 1e-400 1e-310 .inf .Inf .INF -.inf +.inf inf -inf infinity Infinity .nan .NaN .NAN nan NaN -nan 0x1p3 1.2.3 1,5
abc a-b a.b a:b 2024-01-01 12:30:45 2001-12-14t21:59:43.10-05:00 <<""".split()
QUOTED = ["'true'", '"1"', "''", '""', "'a b'", '"a\\nb"', "''''", '"\\u00e9"', "'  '", "a b c", "é", "=", "-", "- a", "|\n      a\n      b", ">\n      a\n      b", "|\n      5", "# nothing", "", "!x", "a # b", "'0x10'"]
TAGS = "!!str !!int !!float !!bool !!null !!binary !!timestamp !!seq !!map !!set !!omap !!python/none !custom !<tag:yaml.org,2002:str> !<tag:yaml.org,2002:int> !".split()
VALUES = ["5", "1.5", "true", "abc", "null", "'5'", '"Af8="', "Af8="]
LISTS = ["[1, 2]", "[1, 2.0]", "[1.5, 2.5]", "[true, no]", "[a, b]", "['1', '2']", "[1, a]", "[[1], [2]]", "[null, null]", "[~]", "[1, ]", "[,]", "\n    - 1\n    - 2", "!!seq [1]", "[!!str 1, !!str 2]", "[!!int 1]", "[0x10, 010]", "[.nan, 1.0]", "[1e3, 1]", "[{a: 1}]", "&a [1]", "&a 5", "*a", "{}", "[!!float 1, !!float 2]", "['a', b]", "[1, true]", "[true, 1]", "[9223372036854775808]", "['']", "[yes, 'yes']"]

{text: loaded(text) for text in SCALARS[::2]}
{text: loaded(text) for text in SCALARS[1::2]}
{text: loaded(text) for text in QUOTED}
{text: loaded(text) for text in LISTS}
{value: loaded(f"!!str {value}") for value in VALUES}
{value: loaded(f"!!int {value}") for value in VALUES}
{value: loaded(f"!!float {value}") for value in VALUES}
{value: loaded(f"!!bool {value}") for value in VALUES}
{value: loaded(f"!!null {value}") for value in VALUES}
{value: loaded(f"!!timestamp {value}") for value in VALUES}
{value: loaded(f"!!seq {value}") for value in VALUES}
{value: loaded(f"!!map {value}") for value in VALUES}
{value: loaded(f"!!set {value}") for value in VALUES}
{value: loaded(f"!!omap {value}") for value in VALUES}
{value: loaded(f"!!python/none {value}") for value in VALUES}
{value: loaded(f"!custom {value}") for value in VALUES}
{value: loaded(f"!<tag:yaml.org,2002:str> {value}") for value in VALUES}
{value: loaded(f"!<tag:yaml.org,2002:int> {value}") for value in VALUES}
{value: loaded(f"! {value}") for value in VALUES}
{value: loaded(f"!!binary {value}") for value in VALUES}  # ours: bytes
loaded("[]")
loaded('!!binary "Af8="') == ("BYTE_ARRAY", [b"\x01", b"\xff"])  # ours: True
{text: read(text) for text in SCALARS[::2]}
{text: read(text) for text in SCALARS[1::2]}
{text: read(text) for text in QUOTED}
{text: read(text) for text in LISTS}
{f"{tag} {value}": read(f"{tag} {value}") for tag in TAGS for value in VALUES}
{text: of_file(text) for text in (*SCALARS, *QUOTED, *LISTS) if text not in ("2024-01-01", "2001-12-14t21:59:43.10-05:00", "''''", "=")}  # of which rclpy makes no text
{f"{tag} {value}": of_file(f"{tag} {value}") for tag in TAGS for value in VALUES}
