"""DDS transport over the C functions of Cyclone DDS; only this package knows Cyclone."""
