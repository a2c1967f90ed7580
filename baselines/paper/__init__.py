"""The paper's study, whole: `python -m baselines.paper` (El Hariry et al., arXiv 2510.16738)."""
