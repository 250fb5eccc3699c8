"""Atomic writes of files: a reader sees the old content or the new content, never a part.

A file is written under a random name in the same folder, and renamed when it is complete. The
random name is created exclusively, so no link is followed. `folder` makes a staging directory: a
caller completes a new folder in it, then moves the new folder to its final path. If the process is
killed, temporary files and directories remain. When they are more than an hour old, the next
`replacing` in the same folder removes the files, and the next `folder` the directories. A living
process locks what it writes, so its files remain however old they are, or seem when the clock is
set.
"""

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import IO, Any, NamedTuple

from ..errors import ChangedError, FileError, SettingError, SpotsError
from . import locks
from .bounded import open_regular

_PREFIX, _SUFFIX = ".spots-", ".part"
_PART = re.compile(r"\.spots-\w{8,16}\.part")
_LOCK = "lock"  # file in a staging directory that its process locks
# A process locks a temporary file just after its creation, and some file systems have no locks.
_STALE_S = 3600.0
_WAIT_S = 5.0  # longest wait for another program that replaces the same file
_ANY = object()


class Kind(NamedTuple):
    """A kind of file that a writer may replace, so that it never replaces a file of another kind.

    `name` has its article: "a calibration file". ``read(path)`` returns the content of a file, or
    raises SpotsError if the file is of another kind.
    """

    name: str
    read: Callable[[Path], Any]

    def check(self, path: str | Path, was: Any = _ANY) -> None:
        """Check that a file may be replaced: that it has this kind, is empty, or does not exist.

        `was` is what `read` returned when the caller read the file; None if the file did not exist.
        FileError if the file has another kind; ChangedError if it has another content than `was`
        now.
        """
        path = Path(path)
        try:
            if not _has_content(path):
                return
            now = self.read(path)
        except FileNotFoundError:
            return
        except SpotsError:
            raise FileError(
                f"{path} would be replaced, but it is not {self.name}, or it is damaged: name "
                "another file, or move this one",
                path,
            ) from None
        if was is not _ANY and now != was:
            raise ChangedError(f"another program has changed {path}: nothing was written", path)

    def present(self, path: Path) -> Any:
        """Return what a new file would replace, as `read` returns it; None if that is nothing.

        FileError if the file has another kind.
        """
        self.check(path)
        return self.read(path) if _has_content(path) else None


def _has_content(path: Path) -> bool:
    """Return whether there is a file that is not empty; `replacing` refuses what is no file."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return False
    return stat.S_ISREG(status.st_mode) and status.st_size > 0


def begins(name: str, *heads: bytes) -> Kind:
    """Return the `Kind` of files that begin with one of several byte strings."""

    def read(path: Path) -> None:
        with open_regular(path) as file:
            if not file.read(max(map(len, heads))).startswith(heads):
                raise FileError(f"{path} is not {name}: name another file", path)

    return Kind(name, read)


def distinct(named: Mapping[str, Path]) -> None:
    """Check that options name different files, because a command writes to each of them."""
    options: dict[Path, str] = {}
    for option, path in named.items():
        other = options.setdefault(path.resolve(), option)
        if other != option:
            raise SettingError(f"{other} and {option} name the same file, {path}: name two files")


@contextmanager
def replacing(
    path: str | Path,
    over: Kind | None,
    mode: str = "b",
    *,
    was: Any = _ANY,
    locked: bool = False,
    **options,
) -> Iterator[IO]:
    """Create or replace a file atomically, when a ``with`` block ends without an exception.

    A symbolic link with this name is replaced and not followed. The permissions of a replaced file
    are kept. Without `over`, an existing file is an error; `was` is that of `Kind.check`. `mode` is
    ``b`` or ``t``. With `locked`, the caller already holds the lock of the file, see `locks.held`.
    The options are those of `open`. FileError if the file cannot be written or must not be
    replaced; an existing file is unchanged.
    """
    path = Path(path)
    part = path.parent / f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}"
    try:
        if over is None and os.path.lexists(path):
            raise exists(path)
        kept = _kept_mode(path)
        if over is not None:
            over.check(path, was)
        # A replacement of a private file is private from its first byte on.
        access = 0o666 if kept is None else 0o600
        _sweep(path.parent, os.DirEntry.is_file, os.unlink)
        with open(
            part, "x" + mode, opener=lambda path, flags: os.open(path, flags, access), **options
        ) as file:
            _mark(file.fileno())
            yield file
            sync(file)
        if kept is not None and stat.S_IMODE(part.stat().st_mode) != kept:
            part.chmod(kept)
        if over is None:
            _place_new(part, path)
            return
        with nullcontext() if locked else locks.held(path, _WAIT_S):
            over.check(path, was)
            os.replace(part, path)
    except OSError as error:
        raise not_written(path, error) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_text(text: str, path: str | Path, over: Kind | None, **options) -> None:
    """Create or replace a text file atomically, see `replacing`.

    Line ends are written unchanged.
    """
    with replacing(path, over, "t", encoding="utf-8", newline="\n", **options) as file:
        file.write(text)


def sync(file: IO) -> None:
    """Wait until everything written to a file is on the storage medium, or raise OSError."""
    file.flush()
    os.fsync(file.fileno())


def append(path: Path, data: bytes, end: int | None = None) -> None:
    """Append bytes to a file, or create it, and wait until they are on the storage medium.

    The caller holds the file's lock, see `locks.held`. The file is cut to the size `end` before, if
    its end is incomplete. After an OSError, the file has none of the bytes.
    """
    # Unbuffered: after an error, a buffer would be written again when the file is closed.
    with open(path, "ab", buffering=0) as file:
        if end is None:
            end = file.seek(0, os.SEEK_END)
        else:
            file.truncate(end)
        try:
            view = memoryview(data)
            while view:
                view = view[file.write(view) :]
            sync(file)
        except BaseException:
            # Also after a failed sync: the file must not have what may not be on the disk.
            with suppress(OSError):
                file.truncate(end)
            raise


@contextmanager
def folder(parent: Path) -> Iterator[Path]:
    """Make a staging directory in the folder `parent`, and remove the directory on exit.

    A caller completes a new folder in this directory, then moves the new folder to its final path.
    OSError if the directory cannot be created.
    """
    _sweep(parent, os.DirEntry.is_dir, shutil.rmtree)
    with (
        tempfile.TemporaryDirectory(
            _SUFFIX, _PREFIX, parent, ignore_cleanup_errors=True
        ) as staging,
        open(Path(staging, _LOCK), "xb") as file,
    ):
        _mark(file.fileno())
        yield Path(staging)


@contextmanager
def temporary() -> Iterator[Path]:
    """Make an empty folder for temporary files, and remove the folder on exit; see `folder`."""
    with folder(Path(tempfile.gettempdir())) as staging:
        inner = staging / "files"
        inner.mkdir()
        yield inner


def not_written(path: Path, error: OSError) -> SpotsError:
    """Return the error for a file that cannot be written."""
    if not path.parent.is_dir():
        return FileError(f"there is no folder {path.parent}: make it first", path.parent)
    reason = error.strerror or error
    return FileError(f"cannot write {path}: {reason}; name another file or folder", path)


def check_writable(path: Path, over: Kind | None = None, *, append: bool = False) -> None:
    """Check that a file can be created or replaced, before work whose result goes into the file.

    File and folder are unchanged. With `append`, the file will be appended to instead of replaced.
    FileError if the file cannot be written, or is of another kind than `over`.
    """
    try:
        kept = _kept_mode(path)
        if over is not None:
            over.check(path)
        if kept is not None and append:
            open(path, "ab").close()
            return
        with tempfile.NamedTemporaryFile(prefix=_PREFIX, suffix=_SUFFIX, dir=path.parent):
            pass
    except OSError as error:
        raise not_written(path, error) from None


def exists(path: Path) -> SpotsError:
    """Return the error for a file that must be new but exists."""
    return FileError(f"{path} exists: choose another name or remove it", path)


def _place_new(part: Path, path: Path) -> None:
    """Rename the complete file `part` to `path`; raise SpotsError if `path` exists."""
    try:
        os.link(part, path)
    except OSError:  # also on a file system without hard links
        if os.path.lexists(path):
            raise exists(path) from None
        os.replace(part, path)


def _kept_mode(path: Path) -> int | None:
    """Return the permissions of the file at `path`, or None if there is no file.

    A folder, a pipe or a device at `path` is an error.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    return mode & 0o777


def _sweep(parent: Path, is_kind: Callable[..., bool], remove: Callable[[str], None]) -> None:
    """Remove temporary files or folders that killed processes left more than an hour ago."""
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name) and is_kind(entry, follow_symlinks=False):
                with suppress(OSError):
                    changed_s = entry.stat(follow_symlinks=False).st_mtime
                    if time.time() - changed_s > _STALE_S and not _in_use(Path(entry.path)):
                        remove(entry.path)


def _mark(handle: int) -> None:
    """Mark a new open file as in use by this process, for `_in_use`."""
    with suppress(OSError):  # a file system without locks, where `_sweep` removes nothing
        locks.lock(handle)


def _in_use(path: Path) -> bool:
    """Return whether a living process, such as this one, writes a temporary file or directory."""
    try:
        handle = os.open(path / _LOCK if path.is_dir() else path, os.O_RDWR)
    except FileNotFoundError:
        return False  # killed before `_mark`
    try:
        return not locks.lock(handle)
    finally:
        os.close(handle)
