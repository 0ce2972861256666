"""The operator's records: every booking, trucks, totals and tickets, in one SQLite file (its chapter: README.md)."""
