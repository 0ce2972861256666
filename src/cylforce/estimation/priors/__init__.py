"""Priors of the parameters: from the data sheet, the linkages and the links' depth."""
