"""What a travel costs, as a bound, an estimate, or solved; workers and the store."""
