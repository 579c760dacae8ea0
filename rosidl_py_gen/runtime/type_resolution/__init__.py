"""Types of other nodes: what they announce, asking them how a type is defined, and answering when they ask.

May import: names, time, logs, transport, loop, graph, endpoints, parameters.
"""
