"""Agents: learned policies, their training, benchmark and viewers."""
