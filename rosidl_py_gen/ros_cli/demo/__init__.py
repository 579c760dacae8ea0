"""Command ``rosidl-py demo``: a simulated robot that drives in a room, with sensors, services, an action and
parameters.

The package is also an example: it uses public names only. `world` is the room and its physics, `schedule` the time,
`robot` and `camera` are the nodes, and `command` starts them.
"""
