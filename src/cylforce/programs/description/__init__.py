"""Contents of `cylforce describe`: numbers, tables, a drawing, a page."""
