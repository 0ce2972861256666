"""How well buckets are weighed: recordings with true loads, the service, simple scales beside it, and the scores."""
