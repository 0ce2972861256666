"""The programs of `cylforce`, one file each; `commands` are their options and help on the command line, `live` runs on a
bus, `reports` makes the HTML pages.

Work here to add a command or an option.
"""
