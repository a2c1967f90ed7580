"""Golden flights of SatInertiaID-v0: what it did when it was released, at full precision."""
