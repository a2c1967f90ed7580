"""Studies of scenarios: whether the choice of excitation matters there, and whether the rate loop holds."""
