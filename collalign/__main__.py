"""``python -m collalign`` is the same as ``collalign``."""

import sys

from collalign.cli import main

if __name__ == "__main__":
    sys.exit(main())
