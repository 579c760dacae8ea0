"""``rosidl-py bag play``.

`recording` reads the bags and selects topics, `timeline` has the time, `senders` send messages, and `player` combines
them. `play` has the services of rosbag2's player and the keys of the terminal, which call the same methods.
"""
