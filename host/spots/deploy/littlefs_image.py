"""Makes the file system of a board that runs MicroPython: LittleFS, disk version 2.1."""

from ..errors import RequirementError, missing
from .uf2 import SECTOR


def file_system(files: dict[str, bytes], size: int, program: int) -> bytes:
    """Return a file system as MicroPython mounts it (LittleFS, disk version 2.1).

    `size` is in bytes; the runtime writes `program` bytes at once. RequirementError if the files do
    not fit, or littlefs-python is missing.
    """
    try:
        from littlefs import LittleFS, LittleFSError, UserContext
    except ImportError:
        raise missing("an image needs", "littlefs-python", "flash") from None
    context = UserContext(size)
    # A larger cache would store small files in a way that MicroPython's smaller one cannot read.
    disk = LittleFS(
        context,
        mount=False,
        block_size=SECTOR,
        block_count=size // SECTOR,
        read_size=program,
        prog_size=program,
        cache_size=program,
        disk_version=0x00020001,
    )
    try:
        disk.format()
        disk.mount()
        for path, data in files.items():
            if "/" in path:
                disk.makedirs(path.rpartition("/")[0], exist_ok=True)
            with disk.open(path, "wb") as file:
                file.write(data)
        disk.unmount()
    except LittleFSError as error:
        raise RequirementError(
            f"the firmware does not fit into {size >> 10} KiB ({error}): use a runtime with a "
            "larger file system"
        ) from None
    return bytes(context.buffer)
