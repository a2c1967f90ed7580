"""Control that the core runs itself: what the wheels can give and store, and the loop that tracks a body rate."""
