"""Server of the Foxglove WebSocket protocol, with which viewers show the ROS graph.

`serve` runs the server. `server` accepts viewers and has a connection to each, and `protocol` parses and formats
messages. `topics` and `services` show the ROS graph to viewers, publish messages of viewers, and call services; they
use `tasks`. Everything runs on the event loop, except that large messages and definitions are decoded in a thread.
`limits` has the maximum counts and sizes.
"""
