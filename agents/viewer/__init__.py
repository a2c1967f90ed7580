"""Viewer: an episode of two policies, live in the terminal or as a video."""
