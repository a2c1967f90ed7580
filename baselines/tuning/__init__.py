"""Tuning: the best settings of every baseline and of the filter, on tuning seeds."""
