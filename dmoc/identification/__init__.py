"""A robot's dynamics from its logs: filter, regressor, a fit that stays physical, faults."""
