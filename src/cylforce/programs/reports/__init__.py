"""HTML reports: figures, tables and texts of commissioning and diagnosis. Work here on the content of a report."""
