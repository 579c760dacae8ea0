"""``rosidl-py topic``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "bw": ("measure", "Print how many bytes per second arrive."),
        "delay": ("measure", "Print how old messages are when they arrive, by the stamp in their headers."),
        "echo": ("echo", "Print the messages of a topic."),
        "find": ("list", "Print the topics of a type."),
        "hz": ("measure", "Print how often messages arrive."),
        "info": ("info", "Print the type of a topic, and who publishes and subscribes."),
        "list": ("list", "Print the topics there are."),
        "pub": ("pub", "Publish messages."),
        "type": ("info", "Print the type of a topic."),
    },
)
def topic() -> None:
    """Topics: list, info, echo, pub, hz, bw, delay, type, find."""
