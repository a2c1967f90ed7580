"""Fuzzing: random environments, valid and spoiled, flown and compared with what must be true of all of them."""
