"""Command group ``rosidl-py topic``."""

from rosidl_py_gen.ros_cli.groups import LazyGroup

topic = LazyGroup(
    "topic",
    package=__name__,
    help="Topics: list, info, echo, pub, hz, bw, delay, plot, type, find.",
    verbs={
        "bw": ("measure", "Print the received bytes per second."),
        "delay": ("measure", "Print the age of messages at their arrival, by the stamp in their headers."),
        "echo": ("echo", "Print the messages of a topic."),
        "find": ("list", "Print the topics of a type."),
        "hz": ("measure", "Print the rate of messages."),
        "info": ("info", "Print the type of a topic, and its publishers and subscriptions."),
        "list": ("list", "Print the topics."),
        "plot": ("plot", "Plot fields of topics while messages arrive."),
        "pub": ("pub", "Publish messages."),
        "type": ("info", "Print the type of a topic."),
    },
)
