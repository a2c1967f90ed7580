"""Stable-Baselines3: the training loop of its algorithms, and checkpoints of their state."""
