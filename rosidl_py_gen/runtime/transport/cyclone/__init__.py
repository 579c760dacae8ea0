"""The transport over Cyclone DDS, by the C functions of its library; all that is known of Cyclone is in here.

May import: what transport may.
"""
