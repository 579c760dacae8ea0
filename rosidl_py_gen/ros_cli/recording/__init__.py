"""``rosidl-py bag record``: `selection` chooses topics, `recorder` receives messages, `writer` writes them."""
