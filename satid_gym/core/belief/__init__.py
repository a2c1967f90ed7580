"""Belief: the filters, which see readings and prior alone."""
