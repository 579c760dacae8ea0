"""What ``rosidl-py graph`` shows: who is connected with whom, in four forms."""
