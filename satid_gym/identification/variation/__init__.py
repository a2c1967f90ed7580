"""Variation of the inertia over time."""
