"""Training: PPO, SAC and imitation, with the folder that every run leaves."""
