"""``rosidl-py bag play``.

Decides what of a recording is played (selection), when (timeline), how each message is sent (senders, requests), and
who may steer that: keys of a terminal, and the services of rosbag2's player (controls). `player` brings them together.
"""
