"""The command line, called in this process."""

import sys

from cylforce.programs import cli


def cylforce_(*words):
    """The command in this process: its exit code."""
    arguments, sys.argv = sys.argv, ["cylforce", *map(str, words)]
    try:
        cli.main()
    except SystemExit as end:
        return end.code or 0
    finally:
        sys.argv = arguments
    return 0
