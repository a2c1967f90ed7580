"""Batch regression: inertia from a whole record of readings."""
