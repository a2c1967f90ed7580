"""Panels and tanks in the momentum balance, and what logs tell of them."""
