"""``rosidl-py bag play``.

`recording` reads the bags and selects topics, `senders` send messages, and `player` combines them with the time, for
the services of rosbag2's player and the keys of the terminal, too.
"""
