"""Parameters without nodes."""
# ruff: noqa
# fmt: off

import array
import numpy as np
from rcl_interfaces.msg import Parameter as PM, ParameterValue
from rclpy.parameter import *
from rclpy.parameter import Parameter, get_parameter_value, parameter_dict_from_yaml_file, parameter_value_to_python
import pathlib, tempfile
folder = pathlib.Path(tempfile.mkdtemp())
(folder / "a.yaml").write_text("/**:\n  ros__parameters:\n    a: 1\n    n: {b: 2.5, c: [x, y]}\nnode1:\n  ros__parameters:\n    a: 2\n")
(folder / "b.yaml").write_text("a: 1\n")

Parameter("a")
Parameter("a",value=1).type_
Parameter("a",value=True).type_
Parameter("a",value=[]).type_
Parameter("a",value=[b"a"]).type_
Parameter("a",value=b"a").type_
Parameter("a",value=(1,2)).value
Parameter("a",value=array.array("i",[1])).type_
Parameter("a",value=np.array([1]))
Parameter("a",value=np.float64(1)).type_
Parameter("a",value=np.int64(1)).type_
Parameter("a",value=[1,2.0])
Parameter("a",value=[1,True]).type_
Parameter("a",value={})
Parameter("a",Parameter.Type.DOUBLE,1)
Parameter("a",Parameter.Type.DOUBLE_ARRAY,[1.0,2.0]).get_parameter_value()
Parameter("a",5,1)
Parameter(5,value=1).name
Parameter("a",Parameter.Type.BYTE_ARRAY,[b"ab"])
Parameter("a",Parameter.Type.BYTE_ARRAY,[b"a"]).get_parameter_value()
Parameter("a",Parameter.Type.INTEGER,2**63).get_parameter_value()
Parameter("a",Parameter.Type.INTEGER,True).value
Parameter("a",Parameter.Type.BOOL_ARRAY,[]).value
Parameter("a",Parameter.Type.STRING_ARRAY,("x",)).get_parameter_value()
Parameter("a",value="x").to_parameter_msg()
repr(Parameter("a",value=1))[:30]
Parameter("a",value=1)==Parameter("a",value=1)
Parameter.Type.INTEGER
Parameter.Type(2)
Parameter.Type(99)
Parameter.Type.INTEGER==2
Parameter.Type.from_parameter_value(object())
Parameter.Type.INTEGER.check("a")
Parameter.from_parameter_msg(PM(name="x",value=ParameterValue(type=8,double_array_value=[1.0]))).value
Parameter.from_parameter_msg(PM(name="x",value=ParameterValue(type=99)))
Parameter.from_parameter_msg(PM(name="x"))
parameter_value_to_python(ParameterValue(type=7,integer_array_value=[1]))
parameter_value_to_python(ParameterValue(type=99))
parameter_value_to_python(ParameterValue(type=5,byte_array_value=[b"a"]))
get_parameter_value("1")
get_parameter_value("1.5").double_value
get_parameter_value("true").bool_value
get_parameter_value("abc").string_value
get_parameter_value("[1,2]").integer_array_value
get_parameter_value("[1,2.0]")
get_parameter_value("[]").type
get_parameter_value("")
get_parameter_value("null").string_value
get_parameter_value("[a,b]").string_array_value
get_parameter_value("{a: 1}").string_value  # ours: no ROS message can hold what rclpy makes of it, or it raises
get_parameter_value("a: b: c")  # ours: no ROS message can hold what rclpy makes of it, or it raises
get_parameter_value("[a")
get_parameter_value("2020-01-01").string_value  # ours: no ROS message can hold what rclpy makes of it, or it raises
get_parameter_value("!!binary YQ==")  # ours: no ROS message can hold what rclpy makes of it, or it raises
get_parameter_value("[[1]]").string_value
get_parameter_value("@x")  # ours: no ROS message can hold what rclpy makes of it, or it raises
get_parameter_value(5)  # text
get_parameter_value("1e5").type
get_parameter_value("0x10").integer_value
get_parameter_value("yes").type
get_parameter_value("\"5\"").string_value
PARAMETER_SEPARATOR_STRING
sorted(parameter_dict_from_yaml_file("nope.yaml").items())
parameter_dict_from_yaml_file(str(folder / "a.yaml"), use_wildcard=True)
parameter_dict_from_yaml_file(str(folder / "a.yaml"))
parameter_dict_from_yaml_file(str(folder / "a.yaml"), True, ["node1"], "ns.")
parameter_dict_from_yaml_file(str(folder / "a.yaml"), False, ["nope"])
parameter_dict_from_yaml_file(str(folder / "b.yaml"))
get_parameter_value("2020-99-99").string_value  # ours: a text, where yaml raises ValueError
get_parameter_value("[" * 5000).string_value  # ours: a text, where yaml raises RecursionError
