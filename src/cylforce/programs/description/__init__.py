"""What `cylforce describe` shows of a machine file: numbers, tables, a drawing, a page."""
