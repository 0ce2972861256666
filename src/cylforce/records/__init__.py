"""What the operator keeps: every booking, trucks, totals and tickets, in one SQLite file (its chapter: README.md)."""
