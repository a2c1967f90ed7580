"""C99 of filter, policy and rate loop for a flight computer, translated from the core."""
