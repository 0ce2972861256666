"""Friction laws of a cylinder, one file each. Work here to add or change a friction law."""
