"""Plans of the oracles: what each searches, by scenario."""
