"""Benchmark: learned against scripted and closed-loop policies on the same held-out episodes."""
