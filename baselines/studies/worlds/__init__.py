"""Worlds of the studies, their satellites, and the policies that fly in them."""
