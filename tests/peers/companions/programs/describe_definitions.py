"""Prints what `rosidl_adapter.parser` makes of the definitions on standard input: a line of JSON for each.

It runs with the real package and with ours.
"""

import json
import re
import sys

from rosidl_adapter import parser
from rosidl_adapter.msg import MSG_TYPE_TO_IDL


def value(found):
    return [type(found).__name__, [*map(value, found)] if isinstance(found, list) else repr(found)]


def attributes(one):
    base = [
        one.pkg_name,
        one.type,
        one.string_upper_bound,
        one.is_primitive_type(),
        str(one),
        hash(one) == hash(str(one)),
    ]
    if isinstance(one, parser.Type):
        base += [one.is_array, one.array_size, one.is_upper_bound, one.is_dynamic_array()]
        base.append(bool(one.is_fixed_size_array()))  # None in Jazzy
    return base


def message(one):
    fields = [
        [attributes(item.type), item.name, value(item.default_value), item.annotations, str(item)]
        for item in one.fields
    ]
    constants = [[item.type, item.name, value(item.value), item.annotations, str(item)] for item in one.constants]
    same = [one == one, one.fields == [*one.fields], one.constants == [*one.constants], one == one.base_type]
    return [attributes(one.base_type), one.msg_name, one.annotations, fields, constants, str(one), same]


def described(call, *arguments):
    try:
        found = getattr(parser, call)(*arguments)
    except RecursionError:
        raise
    except Exception as error:
        return [*(cls.__name__ for cls in type(error).__mro__ if cls is not object), str(error)]
    if isinstance(found, parser.MessageSpecification):
        return message(found)
    if isinstance(found, parser.ServiceSpecification):
        return [found.pkg_name, found.srv_name, message(found.request), message(found.response), str(found)]
    if isinstance(found, parser.ActionSpecification):
        return [found.pkg_name, found.action_name, *map(message, (found.goal, found.result, found.feedback))]
    if isinstance(found, parser.BaseType):
        return attributes(found)
    if isinstance(found, (parser.Constant, parser.Field)):
        return [str(found), found == found, found.annotations]
    return value(found)


for line in sys.stdin:
    call, *arguments = json.loads(line)
    if call == "constants":
        # The public constants are texts, lists and patterns; the tables that ours imports are of other types.
        constants = {name: one for name, one in sorted(vars(parser).items()) if name[0] != "_" and name.isupper()}
        named = {name: one for name, one in constants.items() if isinstance(one, (str, list, re.Pattern))}
        result = {name: getattr(one, "pattern", one) for name, one in named.items()} | MSG_TYPE_TO_IDL
    elif call == "parse_value_string":
        try:
            result = described(call, parser.Type(arguments[0]), arguments[1])
        except Exception as error:
            result = type(error).__name__
    else:
        result = described(call, *arguments)
    print(json.dumps(result), flush=True)
