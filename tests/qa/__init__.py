"""Harnesses that test the tests, the packaging and long runs."""
