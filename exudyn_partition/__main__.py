"""`python -m exudyn_partition` is the command line of module `cli`."""

from .cli import main

if __name__ == "__main__":
    raise SystemExit(main())
