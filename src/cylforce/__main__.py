"""`python -m cylforce`."""

from cylforce.programs.cli import main

main()
