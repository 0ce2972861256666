"""Loading: the lift, the working cycle, and the truck that receives the buckets."""
