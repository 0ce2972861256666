"""What is loaded: the working cycle, and the truck that receives the buckets."""
