"""Interoperation with Fast DDS peers beyond Cyclone: sample identities, and samples sent before Cyclone has matched."""
