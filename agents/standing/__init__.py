"""Standing table: every policy in every scenario, flown by body rates, with what each costs and who keeps the limits."""
