"""Times and durations, clocks that can be set, sleeping by a clock, and when a timer is due.

May import: logs.
"""
