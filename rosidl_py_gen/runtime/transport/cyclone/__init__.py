"""DDS transport based on the C functions of Cyclone DDS; no other package calls Cyclone."""
