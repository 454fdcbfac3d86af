"""Prints a command of the README, so that continuous integration runs exactly what a newcomer reads.

Usage: python3 tests/readme_commands.py {demo,test}
"""

import re
import sys
from pathlib import Path

README = Path(__file__).resolve().parents[1] / "README.md"
HEADINGS = {"demo": "## Try it", "test": "## Run the tests"}


def command(name, text):
    """Return the first bash block below the heading of the command."""
    section = text.split(HEADINGS[name] + "\n", 1)[1]
    block = re.search(r"```bash\n(.*?)\n```", section, re.DOTALL)
    if block is None:
        raise ValueError(f"the README has no bash block below {HEADINGS[name]!r}")
    return block.group(1)


if __name__ == "__main__":
    print(command(sys.argv[1], README.read_text("utf-8")))
