"""Fuzzing: random environments, valid and spoiled, flown and held against what must be true of all of them."""
