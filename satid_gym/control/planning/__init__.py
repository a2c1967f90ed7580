"""Planners: forecasts of rates and filter, and the search for plans."""
