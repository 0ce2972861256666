"""The programs of `cylforce`, one file each; `commands` has their options and help, `live` runs on a bus, `reports`
makes the HTML pages.

Work here to add a command or an option.
"""
