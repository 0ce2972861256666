"""The page in the cab: receives frames from the bus, sends commands by SDO (its chapter: README.md)."""
