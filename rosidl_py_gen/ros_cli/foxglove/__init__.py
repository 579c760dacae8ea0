"""``foxglove``: what runs on ROS 2, for viewers that speak the Foxglove WebSocket protocol.

`serve` puts it together; `server` is what viewers connect to, and looks with `access` at who they are; `viewer` is one
of them; `protocol` reads and writes what is said. The others each follow one thing of the graph: `topics`, `services`,
`parameters`, `connections`, `clock`; `publishing` is the way back. All of it runs on the event loop, except that large
messages are decoded, and definitions compiled, in threads of `decoding`. `limits` has the numbers.
"""
