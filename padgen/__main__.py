"""``python -m padgen`` is the ``padgen`` command."""

from padgen.cli import main

if __name__ == "__main__":
    main()
