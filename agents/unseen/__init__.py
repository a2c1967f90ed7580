"""Comparison on satellites that no policy was trained or tuned on."""
