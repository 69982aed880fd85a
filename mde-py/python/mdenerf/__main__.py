"""``python -m mdenerf`` and the script ``mde`` run the program."""

import os
import subprocess
import sys

from ._program import program


def main() -> None:
    """Replaces this process by the program, with the same arguments."""
    path = str(program())
    if os.name == "nt":
        sys.exit(subprocess.run([path, *sys.argv[1:]], check=False).returncode)
    os.execv(path, [path, *sys.argv[1:]])


if __name__ == "__main__":
    main()
