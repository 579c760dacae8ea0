"""Actions: goals, their states, servers and clients."""
