"""Interoperation with peers on Fast DDS, which Cyclone lacks: sample identities of services, and samples sent before
endpoints match.
"""
