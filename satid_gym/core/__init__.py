"""Core: the compiled episode, truth and belief on either side of a wall."""
