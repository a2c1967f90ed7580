"""Mutation testing: whether the tests notice a wrong sign, bound, constant or order in the code they test."""
