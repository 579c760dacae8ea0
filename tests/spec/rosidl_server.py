"""Reads interface definitions with the real rosidl tool chain, one JSON line in, one JSON line out.

Runs under the interpreter that has Debian's python3-rosidl and python3-empy, never under pytest, and imports nothing of
this project. `.msg`, `.srv` and `.action` go through rosidl_adapter (text -> IDL) and rosidl_parser (IDL -> model),
`.idl` through the second only, as the ROS 2 build does it.
"""

# mypy: ignore-errors
import json
import os
import re
import sys
from ast import literal_eval

import lark
from rosidl_adapter import parser as adapter
from rosidl_adapter import resource
from rosidl_parser import definition as model
from rosidl_parser import parser as idl

# type_description_interfaces/msg/FieldType
IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float": 10,
    "double": 11, "char": 13, "wchar": 14, "boolean": 15, "octet": 16,
}  # fmt: skip


def type_row(kind):
    """[type_id, capacity, string_capacity, nested type name], as rosidl_generator_type_description computes them."""
    offset, capacity = 0, 0
    if isinstance(kind, model.Array):
        kind, offset, capacity = kind.value_type, 48, kind.size
    elif isinstance(kind, model.BoundedSequence):
        kind, offset, capacity = kind.value_type, 96, kind.maximum_size
    elif isinstance(kind, model.UnboundedSequence):
        kind, offset = kind.value_type, 144
    if isinstance(kind, model.BasicType):
        return [IDS[kind.typename] + offset, capacity, 0, ""]
    if isinstance(kind, model.NamespacedType):
        return [1 + offset, capacity, 0, "/".join([*kind.namespaces, kind.name])]
    base = 18 if isinstance(kind, model.AbstractWString) else 17
    bound = getattr(kind, "maximum_size", 0)
    return [base + (4 if bound else 0) + offset, capacity, bound, ""]


def default_of(member):
    if not member.has_annotation("default"):
        return None
    value = member.get_annotation_value("default")["value"]
    if isinstance(member.type, model.AbstractNestedType):
        value = list(literal_eval(value))  # what rosidl_generator_py does with it
    return {"value": value}


def message(one):
    fields = [[m.name, type_row(m.type), default_of(m)] for m in one.structure.members]
    constants = [[c.name, getattr(c.type, "typename", "string"), c.value] for c in one.constants]
    return {"fields": fields, "constants": constants}


def to_idl(kind, package, name, text):
    parse = {"msg": adapter.parse_message_string, "srv": adapter.parse_service_string}.get(
        kind, adapter.parse_action_string
    )
    data = {"pkg_name": package, "relative_input_file": f"{kind}/{name}.{kind}", kind: parse(package, name, text)}
    content = resource.evaluate_template(f"{kind}.idl.em", data)
    # The adapter writes ISO 8859-1, the parser reads UTF-8 with universal newlines.
    return re.sub("\r\n?", "\n", content.encode("iso-8859-1").decode("utf-8"))


def answer(request):
    text = request["text"]
    if request["format"] != "idl":
        text = to_idl(request["kind"], request["package"], request["name"], re.sub("\r\n?", "\n", text))
    content = idl.parse_idl_string(text)
    for action in content.get_elements_of_type(model.Action):
        return [message(one) for one in (action.goal, action.result, action.feedback)]
    for service in content.get_elements_of_type(model.Service):
        return [message(one) for one in (service.request_message, service.response_message)]
    return [message(one) for one in content.get_elements_of_type(model.Message)]


def main():
    # em 3.x puts a proxy in the place of sys.stdout and minds when it vanishes; keep the real one to ourselves.
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    for line in sys.stdin:
        try:
            reply = {"messages": answer(json.loads(line))}
            text = json.dumps(reply)
        except (Exception, SystemExit) as error:
            text = json.dumps({"refused": f"{type(error).__name__}: {error}"[:500]})
        replies.write(text + "\n")
        replies.flush()


if __name__ == "__main__":
    assert lark.__version__
    main()
