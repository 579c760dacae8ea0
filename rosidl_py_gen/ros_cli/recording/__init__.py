"""Command ``rosidl-py bag record``: `selection` selects topics, `recorder` receives messages, `writer` writes them."""
