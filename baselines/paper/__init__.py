"""Rerun of the paper's study (El Hariry et al., arXiv 2510.16738): `python -m baselines.paper`."""
