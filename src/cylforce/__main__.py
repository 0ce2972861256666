"""`python -m cylforce` is the command `cylforce`."""

from cylforce.programs.cli import main

if __name__ == "__main__":
    main()
