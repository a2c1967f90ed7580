"""Studies of the error: effects of filter, excitation and faults."""
