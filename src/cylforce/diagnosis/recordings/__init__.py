"""What is asked of recordings before any effect: clocks, readings that jump or shake, references that are strangers."""
