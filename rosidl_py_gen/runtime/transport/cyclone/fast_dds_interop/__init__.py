"""What peers on Fast DDS need of Cyclone that it does not do by itself: identities of requests and replies, and samples
that were sent before it was connected.

May import: what transport may.
"""
