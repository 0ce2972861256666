"""Recordings that a diagnosis cannot use, or not as they are: an answer with its uncertainty, or a sentence that names
the file; never a confident name."""
