"""``rosidl-py bag play``.

`recording` reads the bags and selects topics, `timeline` has the time, `senders` send messages, and `player` combines
them, for the services of rosbag2's player and the keys of the terminal, too.
"""
