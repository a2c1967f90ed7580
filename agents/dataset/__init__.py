"""Flights as data sets for learning offline."""
