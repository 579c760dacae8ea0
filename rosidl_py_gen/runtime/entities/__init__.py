"""Publishers, subscriptions, service clients and servers, and timers of nodes."""
