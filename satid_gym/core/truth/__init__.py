"""Truth: the satellite as it is, its sensors, and how an episode is drawn."""
