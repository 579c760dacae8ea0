"""``rosidl-py tf``: a module for each command, or for several that do nearly the same."""

import click

from rosidl_py_gen.ros_cli.groups import LazyGroup


@click.group(
    cls=LazyGroup,
    package=__name__,
    verbs={
        "echo": ("echo", "Print where SOURCE is in TARGET, again and again."),
        "monitor": (
            "monitor",
            "Print once a second how often the transform of each frame comes.",
        ),
        "tree": (
            "tree",
            "Show which frame has which parent.",
        ),
    },
)
def tf() -> None:
    """Transforms: frames as a tree, one transform, rates and delays."""
