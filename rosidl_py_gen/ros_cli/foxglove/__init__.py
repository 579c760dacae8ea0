"""``foxglove``: a server of the Foxglove WebSocket protocol, for viewers of the ROS graph.

`serve` combines the parts: `server` accepts viewers, `viewer` is one of them, `protocol` reads and writes messages.
`topics`, `services` and `parameters` follow the graph, `publishing` the topics of viewers, with `keyed_tasks`.
Everything runs on the event loop, except that `decoding` has threads for large messages and definitions. `limits` has
the numbers.
"""
