"""Slips that make a log contradict its satellite."""
