"""``rosidl-py graph``: connections of nodes as text, Mermaid, SVG or JSON."""
