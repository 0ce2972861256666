"""What recordings show, and what every effect would add to it: rows of a linear problem, whitened by a noise floor."""
