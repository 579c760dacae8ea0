"""Transports that carry bytes between endpoints: their common interface, QoS, and the implementations in memory, on DDS
and on Zenoh.
"""
