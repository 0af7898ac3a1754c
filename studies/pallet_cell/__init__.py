"""Three robots around a pallet: schedules on one DC link."""
