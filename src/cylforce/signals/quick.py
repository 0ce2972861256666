"""Named tuples that are made in every step."""

new = tuple.__new__  # of a class and all fields in their order: its own constructor takes two to three times as long
