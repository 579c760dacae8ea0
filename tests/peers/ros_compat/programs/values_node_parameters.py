"""Parameters of nodes."""
# ruff: noqa
# fmt: off

import pathlib, tempfile
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rcl_interfaces.msg import FloatingPointRange as FR, IntegerRange as IR, ParameterDescriptor as PD, ParameterValue, SetParametersResult
given = pathlib.Path(tempfile.mkdtemp()) / "given.yaml"
given.write_text("/**:\n  ros__parameters:\n    f: 7\n    arr: [1, 2]\n    s: [a, b]\n    nested: {x: 1.5}\n")
rclpy.init(args=["--ros-args", "-p", "c:=5", "-p", "typed:=hello", "--params-file", str(given)])  # ours: a context manager, as in Kilted
n = Node("n", namespace="ns", parameter_overrides=[Parameter("o", value=3), Parameter("f", value=8)])

n.list_parameters([],0)
n.declare_parameter('a',1)
n.declare_parameter('a',1)
n.declare_parameter('c',1)
n.declare_parameter('f',1)
n.declare_parameter('o',1,ignore_override=True)
n.declare_parameter('arr',[0])
n.declare_parameter('s',['x'])
n.declare_parameter('typed',1)
n.declare_parameter('')
n.declare_parameter('nameonly')
n.get_parameter('nameonly')
n.declare_parameter('t',Parameter.Type.DOUBLE)
n.get_parameter('t')
n.get_parameter_or('t')
n.get_parameter_or('t',Parameter('z',value=1))
n.set_parameters([Parameter('t',value=1.5)])
n.get_parameter('t')
n.set_parameters([Parameter('t')])
n.set_parameters([Parameter('t',value=1)])
n.set_parameters([Parameter('nope',value=1)])[0]  # text
n.set_parameters([5])
n.set_parameters_atomically([Parameter('a',value=2),Parameter('t',value='x')])
n.get_parameter('a')
n.declare_parameter('ns',Parameter.Type.NOT_SET)
n.declare_parameter('dyn',None,PD(dynamic_typing=True))
n.declare_parameter('dynt',Parameter.Type.BOOL,PD(dynamic_typing=True))
n.set_parameters([Parameter('dyn',value='x'),Parameter('dyn',value=3)])
n.describe_parameter('dyn')
n.set_parameters([Parameter('dyn')])
n.has_parameter('dyn')
n.declare_parameter('ro',1,PD(read_only=True))
n.set_parameters([Parameter('ro',value=2)])
n.undeclare_parameter('ro')
n.undeclare_parameter('nope')
n.undeclare_parameter('nameonly')
n.declare_parameter('r',5,PD(integer_range=[IR(from_value=0,to_value=10,step=5)]))
n.set_parameters([Parameter('r',value=v) for v in (10,11,7,-1)])
n.declare_parameter('fr',0.5,PD(floating_point_range=[FR(from_value=0.0,to_value=1.0,step=0.25)]))
n.set_parameters([Parameter('fr',value=v) for v in (0.25,0.3,2.0,1.0000001)])
n.declare_parameter('bad',20,PD(integer_range=[IR(from_value=0,to_value=10)]))
n.has_parameter('bad')
n.declare_parameters('p',[('a',1),('b',2.0,PD()),('c',Parameter.Type.STRING)])
n.declare_parameters('p',[(5,1)])
n.declare_parameters('p',[()])
n.declare_parameters('p',[('x',1,5)])
n.declare_parameters('p',[('new',1),('a',1)])
n.has_parameter('p.new')
n.get_parameters_by_prefix('p')
n.list_parameters(['p'],0)
n.list_parameters(['p'],1)
n.list_parameters([],1)
n.list_parameters(['p.a'],0)
n.list_parameters('p',0)
n.list_parameters([],-1)
n.list_parameters([],1.0)
n.get_parameters(['a','p.b'])
n.get_parameters([5])
n.get_parameter('nope')
n.get_parameter_type('a')
n.get_parameter_types(['a','p.b'])
n.get_parameter_type('nope')
n.describe_parameter('a')
n.describe_parameter('nope')
n.describe_parameters(['a'])
n.set_descriptor('a',PD(type=2,description='d',integer_range=[IR(from_value=5,to_value=9)]))
n.set_descriptor('a',PD(type=2,integer_range=[IR(from_value=5,to_value=9)]),ParameterValue(type=2,integer_value=6))
n.get_parameter('a')
n.set_descriptor('ro',PD())
n.set_descriptor('nope',PD())
n.add_on_set_parameters_callback(5)  # text
n.add_post_set_parameters_callback(5)  # text
n.remove_on_set_parameters_callback(5)
n.declare_parameter('arrd',[1.0])
n.get_parameter('arrd').get_parameter_value().double_array_value
n.declare_parameter('bytes',[b'a'])
n.declare_parameter('dict',{})
n.declare_parameter('emp',[])
n.declare_parameter('pv',ParameterValue(type=2,integer_value=1))
seen = []


def on(ps):
    seen.append(("on", [(p.name, p.value) for p in ps]))
    return SetParametersResult(successful=ps[0].value != 99, reason="no 99")


def on_too(ps):
    seen.append("on too")
    return SetParametersResult(successful=True)


def pre(ps):
    seen.append(("pre", [(p.name, p.value) for p in ps]))
    return [*ps, Parameter("p.a", value=42)]


def post(ps):
    seen.append(("post", [(p.name, p.value) for p in ps]))


def boom(ps):
    raise KeyError("boom")


n.add_on_set_parameters_callback(on)
n.add_on_set_parameters_callback(on_too)
n.add_pre_set_parameters_callback(pre)
n.add_post_set_parameters_callback(post)
(n.set_parameters([Parameter("a", value=7)]), list(seen), seen.clear())
(n.set_parameters([Parameter("a", value=99)]), list(seen), seen.clear())
(n.declare_parameter("late", 1), list(seen), seen.clear())
n.declare_parameter("late2", 99)
n.remove_pre_set_parameters_callback(pre)
n.add_pre_set_parameters_callback(lambda ps: [])
n.set_parameters([Parameter("a", value=8)])
n.add_on_set_parameters_callback(lambda ps: True)
n.declare_parameter("late3", 1)
n.add_on_set_parameters_callback(boom)
n.declare_parameter("late4", 1)
m = Node("m", allow_undeclared_parameters=True, automatically_declare_parameters_from_overrides=True, parameter_overrides=[Parameter("mine", value=1)])
sorted(m.list_parameters([],0).names)
m.get_parameter('nested.x')
m.get_parameter('zz')
m.set_parameters([Parameter('zz',value=1)])
m.get_parameter('zz')
m.set_parameters([Parameter('zz')])
m.has_parameter('zz')
m.get_parameter_type('yy')
m.describe_parameter('yy')
m.set_descriptor('yy',PD())
m.describe_parameter('mine')
m.describe_parameter('use_sim_time')
m.describe_parameter('start_type_description_service')
m.set_parameters([Parameter('start_type_description_service',value=False)])
m.set_parameters([Parameter('use_sim_time',value=5)])
m.set_parameters([Parameter('use_sim_time',value=True)])
m.get_clock().ros_time_is_active
m.get_parameters_by_prefix('nested')
rclpy.shutdown()
