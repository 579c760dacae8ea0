"""``rosidl-py bag play``.

`selection` determines the topics, `timeline` the time, `senders` and `requests` send messages, and `player` combines
them. `controls` has the services of rosbag2's player; keys of the terminal call the same methods.
"""
