"""Who sends on the bus: each sensor by itself, and nobody in its place or in ours."""
