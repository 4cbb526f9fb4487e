"""Programs of controllers, on disk."""

from hashlib import sha256

from ._pickling import result_text


def save(compensated, output, overwrite=False):
    """Writes the program, the file that belongs to it, and beside it what became of its points (JSON), all or none.

    Raises InputError for files that exist, unless overwrite is True, and for one that would replace the original."""
    compensated._save(output, overwrite, sha256(result_text(compensated.calibration._origin)).hexdigest())
