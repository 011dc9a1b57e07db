"""Error maps read of files, past what an upload brings."""

from app.api.uploads import parse_error_map
from app.files.delimited_text import read_sheets


def read_error_map(file, header):
    """Read an error map's table and check all of it."""
    return parse_error_map(read_sheets(file), file, header)
