"""Names of topics, services, nodes and namespaces."""
# ruff: noqa
# fmt: off

import re
from rclpy.validate_topic_name import validate_topic_name
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_node_name import validate_node_name
from rclpy.validate_parameter_name import validate_parameter_name
from rclpy.expand_topic_name import expand_topic_name

validators = (validate_topic_name, validate_full_topic_name, validate_namespace, validate_node_name)


def expand(name):
    return expand_topic_name(name, "node", "/ns")


def outcomes(name, functions=(*validators, expand)):
    found = []
    for function in functions:
        try:
            found.append(function(name))
        except Exception as error:
            found.append((type(error).__name__, re.sub(r", at /\S+", "", str(error))))  # without the place in the C code
    return found


outcomes('')
outcomes('/')
outcomes('a')
outcomes('/a')
outcomes('/a/')
outcomes('a/')
outcomes('~')
outcomes('~/')
outcomes('~/a')
outcomes('~a', validators)
expand_topic_name('~a', "node", "/ns")  # ours: what rcl gives is no name that was meant
outcomes('a~b')
outcomes('{node}')
outcomes('{node')
outcomes('node}')
outcomes('{no{de}}')
outcomes('{}', validators)
expand_topic_name('{}', "node", "/ns")  # text
outcomes('{1a}')
outcomes('{a b}')
outcomes('{foo}', validators)
expand_topic_name('{foo}', "node", "/ns")  # text
outcomes('/{ns}/x')
outcomes('1a')
outcomes('/1a')
outcomes('a/1b')
outcomes('a//b')
outcomes('/a//b')
outcomes('a b')
outcomes('/a b')
outcomes('/a/~')
outcomes('ä')
outcomes('/_x')
outcomes('/a__b')
outcomes('a?')
outcomes('/a{b}', validators)
expand_topic_name('/a{b}', "node", "/ns")  # text
outcomes('{node}/1')
outcomes('~//a')
outcomes('a\n')
outcomes('{no-de}')
outcomes('~{node}')
validate_topic_name("a b", is_service=True)
validate_full_topic_name("a", is_service=True)
validate_topic_name(5)  # text
validate_full_topic_name("/" + "a" * 300)
validate_namespace("/" + "a" * 300)
validate_node_name("a" * 300)
validate_parameter_name("")
validate_parameter_name("a")
expand_topic_name("a", "no de", "/ns")
expand_topic_name("a", "node", "ns")
expand_topic_name("a", "", "/ns")
expand_topic_name("{namespace}/a", "node", "/n")
expand_topic_name("a", "1n", "/")
