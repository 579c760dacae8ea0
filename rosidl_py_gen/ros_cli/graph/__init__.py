"""Command ``rosidl-py graph``: prints the connections of nodes as text, Mermaid, SVG or JSON."""
