"""Studies of scenarios: what their excitation is worth, whether the rate loop holds, and what a filter is not told."""
