"""Publishers and subscriptions, service clients and servers."""
