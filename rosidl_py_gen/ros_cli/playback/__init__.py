"""Command ``rosidl-py bag play``.

`recording` reads bags and selects topics, `senders` has publishers and clients, and `player` sends each message when it
is due. Services of rosbag2's player and keys of the terminal control the player.
"""
