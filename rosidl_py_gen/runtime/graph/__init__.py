"""Graph of nodes, topics, services and endpoints, fed by discovery."""
