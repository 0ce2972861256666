"""The commands of the command line, one file each: options and help; the work is done in `programs`."""
