"""Faults of sensors in the middle of work: recordings in order are edited, the service runs over them, and what it says
is compared with what it says without the fault."""
