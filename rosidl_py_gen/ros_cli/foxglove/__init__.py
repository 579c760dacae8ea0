"""Command ``foxglove``: a server of the Foxglove WebSocket protocol, with which viewers show the ROS graph.

`serve` runs the command. `server` accepts viewers, `viewer` is the connection to one viewer, and `protocol` parses and
formats messages. `topics`, `services` and `parameters` show the ROS graph to viewers, `publishing` publishes messages
of viewers; these four use tasks of `keyed_tasks`. Everything runs on the event loop, except that `decoding` has threads
for large messages and definitions. `limits` has the maximum counts and sizes.
"""
