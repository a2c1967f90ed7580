"""Figures of the paper's study."""
