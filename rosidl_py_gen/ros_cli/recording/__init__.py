"""``rosidl-py bag record``.

`record` runs it, `selection` chooses topics, `recorder` receives their messages, and `writer` writes them.
"""
