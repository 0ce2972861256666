"""Studies of accuracy, time and memory, a module each: `tools/accuracy NAME`."""
