"""How bytes get from endpoint to endpoint: what the node asks of a transport, QoS, and the transports: memory, DDS and Zenoh.

May import: names, logs.
"""
