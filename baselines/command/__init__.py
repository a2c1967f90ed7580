"""Command line: one runner for every command, and the provenance of its results."""
