"""A text file of the user that browsers change, and that other programs can change, too."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from spots.common import atomic
from spots.common.bounded import TOML_MAX_BYTES, encoding_of, read_bytes
from spots.errors import FileError, SpotsError


class UserFile:
    """A text file whose encoding, byte order mark and line ends are kept; it need not exist.

    FileError if its name does not end in ``.toml``, or the file could not be written. `kind` names
    the kind of file in error messages.
    """

    def __init__(self, path: Path, kind: str):
        if path.suffix != ".toml":
            raise FileError(f"'{path}' is not a {kind} file: give a name that ends in .toml", path)
        atomic.check_writable(path)
        self.path, self._kind = path, kind
        self._content = atomic.Kind(f"a {kind} file", lambda path: read_bytes(path, TOML_MAX_BYTES))
        self._known = self._mark = b""  # content as it was last read or written; byte order mark
        self._encoding = "utf-8"

    def read(self) -> str | None:
        """Return the text of the file with its line ends; None if the file does not exist.

        FileError if the file cannot be read as text, is not a regular file, or is too large.
        """
        try:
            data = read_bytes(self.path, TOML_MAX_BYTES)
            mark, encoding = encoding_of(data)
            text = data[len(mark) :].decode(encoding)
        except FileNotFoundError:
            self._known = b""
            return None
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "not UTF-8 text"
            raise FileError(
                f"cannot read the {self._kind} file {self.path} ({reason}): correct or remove it",
                self.path,
            ) from None
        self._known, self._mark, self._encoding = data, mark, encoding
        return text

    @property
    def changed(self) -> bool:
        """Whether another program has written the file since it was read or written here."""
        try:
            self._content.check(self.path, self._known)
        except (OSError, SpotsError):
            return True
        return False

    @contextmanager
    def replacing(self, text: str) -> Iterator[None]:
        """Replace the file atomically, when a ``with`` block ends without an exception.

        The text is on the disk before the block begins, so a full disk is reported first.
        ChangedError if another program has changed the file, which then stays unchanged.
        """
        data = self._mark + text.encode(self._encoding)
        with atomic.replacing(self.path, self._content, was=self._known) as file:
            file.write(data)
            atomic.sync(file)
            yield
        self._known = data
