"""Publishers, subscriptions, service clients and servers, and timers.

May import the rooms below: names, time, logs, transport, loop, graph.
"""
