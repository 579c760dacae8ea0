"""Points in time and durations, clocks with simulated time, sleeping by a clock, and the schedules of timers."""
