"""Standing table: every policy in every scenario, flown by body rates: what each costs, who keeps the limits."""
