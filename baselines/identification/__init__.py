"""Identification from recorded flights: telemetry made from `simulate`, and how often the truth is in the interval."""
