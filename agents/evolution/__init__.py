"""Policies found by evolution, without teacher or gradient."""
