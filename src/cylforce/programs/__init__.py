"""The commands of `cylforce`, one file each. Work here to add a command or an option."""
