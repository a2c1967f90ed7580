"""Tours of the corners of the rate envelope: choice of a corner, its features, and what they rest on."""
