"""Interoperation with Fast DDS peers that Cyclone lacks: sample identities, and samples sent before the match."""
