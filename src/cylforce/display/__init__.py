"""The page in the cab: listens to the bus, sends commands by SDO (its chapter: README.md)."""
