"""The program `mde`, which is part of the package."""

import os
from pathlib import Path

from ._mdenerf import Error


def program() -> Path:
    """The path of the program ``mde`` of this package.

    Returns
    -------
    Path
        An executable file, of the same version as the package.

    Raises
    ------
    Error
        Where the package was installed without it.
    """
    path = Path(__file__).with_name("bin") / ("mde.exe" if os.name == "nt" else "mde")
    if not path.is_file():
        raise Error(f"{path}: this installation has no program mde; install the wheel of mdenerf again")
    return path
