"""``foxglove``: what runs on ROS 2, for viewers that speak the Foxglove WebSocket protocol.

`serve` puts it together; `server` is the only module that knows the SDK, and meets its threads; `front` is what viewers
connect to, and looks with `access` at who they are; the others each follow
one thing of the graph: `topics`, `services`, `parameters`, `connections`, `clock`; `publishing` is the way back.
"""
