"""Compiles interface definitions with the real rosidl tool chain, one JSON line in, one JSON line out.

Runs under the interpreter of an environment that has the tool chain's packages from PyPI, never under pytest, and
imports nothing of this project. `.msg`, `.srv` and `.action` go through rosidl_adapter (text -> IDL) and rosidl_parser
(IDL -> model), `.idl` through the second only, and the models through rosidl_generator_type_description, as the ROS 2
build does it.

In:  {"definitions": [{"package", "kind", "name", "format", "text"}, ...], "keep": false}
Out: {"refused": why}, or {"messages": for each definition its messages, "types": name -> [description, hash]}.
The hash of a type that contains itself or refers to an unknown one is null; known is what the line holds, and lines
before it with "keep".
"""

# mypy: ignore-errors
import json
import os
import re
import sys
from ast import literal_eval

import rosidl_generator_type_description as generator
from rosidl_adapter import parser as adapter
from rosidl_adapter import resource
from rosidl_parser import definition as model
from rosidl_parser import parser as idl

KEPT = {}
ADD = {model.Message: generator.add_msg, model.Service: generator.add_srv, model.Action: generator.add_action}


def default_of(member):
    if not member.has_annotation("default"):
        return None
    value = member.get_annotation_value("default")["value"]
    if isinstance(member.type, model.AbstractNestedType):
        value = list(literal_eval(value))  # what rosidl_generator_py does with it
    return {"value": value}


def message(one):
    fields = [
        [m.name, list(generator.serialize_field_type(m.type).values()), default_of(m)] for m in one.structure.members
    ]
    constants = [[c.name, getattr(c.type, "typename", "string"), c.value] for c in one.constants]
    return {"fields": fields, "constants": constants}


def messages(interface):
    match interface:
        case model.Action():
            return [message(one) for one in (interface.goal, interface.result, interface.feedback)]
        case model.Service():
            return [message(one) for one in (interface.request_message, interface.response_message)]
        case _:
            return [message(interface)]


def to_idl(kind, package, name, text):
    parse = {"msg": adapter.parse_message_string, "srv": adapter.parse_service_string}.get(
        kind, adapter.parse_action_string
    )
    data = {"pkg_name": package, "relative_input_file": f"{kind}/{name}.{kind}", kind: parse(package, name, text)}
    content = resource.evaluate_template(f"{kind}.idl.em", data)
    # The adapter writes ISO 8859-1, the parser reads UTF-8 with universal newlines.
    return re.sub("\r\n?", "\n", content.encode("iso-8859-1").decode("utf-8"))


def interface(package, kind, name, format, text):
    text = re.sub("\r\n?", "\n", text)
    content = idl.parse_idl_string(text if format == "idl" else to_idl(kind, package, name, text))
    return next(one for one in content.elements if type(one) in ADD)


def type_hash(name, known):
    try:
        return generator.calculate_type_hash(generator.extract_full_type_description(name, known))
    except KeyError:  # of the unknown type; or of defaults removed twice, from the type and from what it refers to
        return None


def answer(request):
    found = [interface(**one) for one in request["definitions"]]
    types = {}
    for one in found:
        ADD[type(one)](one, types)
    described = {
        name: generator.serialize_individual_type_description(one.namespaced_type, one.members)
        for name, one in types.items()
    }
    known = {**KEPT, **described}
    if request["keep"]:
        KEPT.update(described)
    return {
        "messages": [messages(one) for one in found],
        "types": {name: [one, type_hash(name, known)] for name, one in described.items()},
    }


def main():
    # em puts a proxy in the place of sys.stdout and minds when it vanishes; keep the real one to ourselves.
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    for line in sys.stdin:
        try:
            text = json.dumps(answer(json.loads(line)))
        except (Exception, SystemExit) as error:
            text = json.dumps({"refused": f"{type(error).__name__}: {error}"[:500]})
        replies.write(text + "\n")
        replies.flush()


if __name__ == "__main__":
    main()
