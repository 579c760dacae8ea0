"""How bytes get from endpoint to endpoint: what the node asks of a transport, QoS, and two transports, memory and DDS.

May import: names, logs.
"""
