"""The commands of `cylforce`, one file each; `live` runs on a bus, `reports` makes the HTML pages.

Work here to add a command or an option.
"""
