"""HTML reports: figures, tables and texts of commissioning and diagnosis. Work here on what a report shows."""
