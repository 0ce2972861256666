"""The command line, one file for each command: its options, its help, an example.

Work here to change an option; `cli` lists the commands in the order of their use.
"""
