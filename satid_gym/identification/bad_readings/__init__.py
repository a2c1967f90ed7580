"""Readings that are left out of a fit: spikes, those at the end of a gyro's range, and faults of tachometers."""
