"""Summary of a comparison: statistics of its scores, rankings and tables."""
