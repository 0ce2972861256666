"""The force at the tool as it is now: its errors, what of it is the load's, and what happens at the teeth."""
