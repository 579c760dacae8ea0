"""How bytes get from endpoint to endpoint: what is asked of a transport, QoS, and three of them: memory, DDS, Zenoh.

May import: names, logs.
"""
