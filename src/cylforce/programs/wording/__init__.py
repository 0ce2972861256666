"""The answer of a diagnosis in plain words, for the terminal and for the page alike."""
