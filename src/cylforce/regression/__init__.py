"""Floor 3: filters, filtered regressor, batch and recursive least squares."""
