"""``rosidl-py bag play``.

`selection` determines the topics, `timeline` the time, `publishers` and `requests` send messages, and `player` combines
them. `play` has the services of rosbag2's player and the keys of the terminal, which call the same methods.
"""
