"""Present force at the tool: its errors, the load's part of it, and the events at the teeth."""
