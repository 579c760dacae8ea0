"""Transports that carry bytes between endpoints: the contract, QoS, and three implementations: memory, DDS, Zenoh."""
