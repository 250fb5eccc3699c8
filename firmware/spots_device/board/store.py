"""Stored settings, calibrations and layouts of all strips: a power cut leaves the old or the new.

Only the command ``save`` writes these files. What one save stores is a *generation*: a file for
each part, such as ``calibration1-a.txt``, and an index, ``saved-a.txt``, with the checksums of
these files. The name of each file ends in a or b. A save writes to the names that the present
generation does not use: first the parts that have changed, then the index. So the present
generation is complete until the new index is. It then remains for the case that a newer file is
damaged; the generation before it is overwritten. No file is renamed, because FAT cannot replace a
file.
"""

import os
from binascii import crc32

from .. import const
from .settings import checksum

_INDEX = "saved"
_ENDS = ("a", "b")
_CHUNK = const(128)
_EIO = const(5)
_STAT_SIZE = const(6)  # index in the result of `os.stat`


class Store:
    """The generation in use. The constructor reads all files, to find a complete generation.

    Attributes
    ----------
    fault : str or None
        Sentence that names a damaged file and what is used instead; None if there is none, and
        after a save.
    """

    def __init__(self):
        self.fault = None
        self._number = 0  # counts the generations
        self._end = _ENDS[1]  # of the index
        self._files = {}  # by part: end of the file's name, and checksum of the file
        indexes, damaged = _indexes()
        for number, end, files in indexes:
            self._number = max(self._number, number)
            bad = [name for name in sorted(files) if not _is_whole(name, files[name])]
            if not bad:
                self._use(end, files, damaged, "the save before it is used")
                return
            damaged += [_path(name, files[name][0]) for name in bad]
        if indexes:
            _, end, files = indexes[0]
            files = {name: files[name] for name in files if _is_whole(name, files[name])}
            self._use(end, files, damaged, "the other files are used")
            return
        self._use(self._end, {}, damaged, "the default settings are used")

    def _use(self, end, files, damaged, instead):
        self._end = end
        self._files = files
        if damaged:
            self.fault = "%s is damaged, or its save was interrupted: %s" % (damaged[0], instead)

    def load(self, name):
        """Return the lines of a part, such as ``layout1``; an empty list if nothing is stored.

        Raises
        ------
        ValueError
            If the file cannot be read.
        """
        if name not in self._files:
            return []
        path = _path(name, self._files[name][0])
        try:
            with open(path, "rb") as file:
                return [line[:-1].decode() for line in file]
        except OSError as error:
            raise ValueError("%s cannot be read (%s)" % (path, error))

    def save(self, parts):
        """Store parts as the next generation; a part that is not given keeps its file.

        Nothing is written if nothing has changed, because flash wears out. The lines are not
        copied.

        Parameters
        ----------
        parts : iterable of (str, list of str)
            Name and lines of each part; a part without lines is removed.

        Raises
        ------
        OSError
            If a file cannot be written. The present generation then remains.
        """
        files = dict(self._files)
        written = []
        try:
            for name, lines in parts:
                self._put(name, lines, files, written)
            if written or files != self._files or self.fault:
                self._commit(files, written)
        except OSError:
            for path in reversed(written):  # frees the space; the index first
                _remove(path)
            raise

    def _put(self, name, lines, files, written):
        if not lines:
            files.pop(name, None)
            return
        there = self._files.get(name)
        crc = checksum(lines)
        if there and there[1] == crc and _is_whole(name, there):
            return
        files[name] = (_other(there[0] if there else _ENDS[1]), crc)
        path = _path(name, files[name][0])
        written.append(path)
        _write(path, lines, crc)

    def _commit(self, files, written):
        lines = ["generation %d" % (self._number + 1)]
        for name in sorted(files):
            lines.append("%s %s %s" % ((name,) + files[name]))
        lines.append("crc " + checksum(lines))
        end = _other(self._end)
        path = _path(_INDEX, end)
        written.append(path)
        _write(path, lines, checksum(lines))
        self._number += 1
        self._end = end
        self._files = files
        self.fault = None


def _path(name, end):
    return "%s-%s.txt" % (name, end)


def _other(end):
    return _ENDS[end == _ENDS[0]]


def _indexes():
    """Return number, end and files of each valid index, newest first; and paths of damaged ones."""
    valid, damaged = [], []
    for end in _ENDS:
        path = _path(_INDEX, end)
        try:
            lines = _sealed_lines(path)
            files = {}
            for line in lines[1:]:
                name, at, crc = line.split()
                files[name] = (at, crc)
            valid.append((int(lines[0].split()[1]), end, files))
        except (ValueError, IndexError):
            if _size(path):  # an interrupted save can leave an empty file, which was never used
                damaged.append(path)
    if len(valid) > 1 and valid[0][0] < valid[1][0]:
        valid.reverse()
    return valid, damaged


def _is_whole(name, file):
    return _crc_of(_path(name, file[0])) == file[1]


def _crc_of(path):
    """Return the checksum of a file, which is that of its lines; None if it cannot be read."""
    chunk = bytearray(_CHUNK)
    view = memoryview(chunk)
    crc = 0
    try:
        with open(path, "rb") as file:
            while True:
                size = file.readinto(chunk)
                if not size:
                    return "%08x" % crc
                crc = crc32(view[:size], crc)
    except (OSError, ValueError):  # an invalid name is a ValueError
        return None


def _write(path, lines, crc):
    with open(path, "wb") as file:
        for line in lines:
            file.write((line + "\n").encode())
    if _crc_of(path) != crc:
        raise OSError(_EIO)


def _remove(path):
    try:
        os.remove(path)
    except OSError:
        pass  # it does not exist, or the file system fails


def _size(path):
    try:
        return os.stat(path)[_STAT_SIZE]
    except OSError:
        return 0


def _sealed_lines(path):
    """Return the lines of a file that ends with its checksum.

    Raises
    ------
    ValueError
        If the file is missing or damaged.
    """
    try:
        with open(path, "rb") as file:
            lines = file.read().decode().replace("\r", "").split("\n")
    except OSError as error:
        raise ValueError(str(error))
    lines = list(filter(None, lines))
    if not lines or lines.pop() != "crc " + checksum(lines):
        raise ValueError("damaged")
    return lines
