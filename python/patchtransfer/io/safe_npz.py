"""Arrays of an `.npz` file without what an archive can hide: nothing is unpickled, nor unpacked beyond what a file has.

NumPy's own reader makes an array of the size that its header says before it looks whether the numbers are there, and
the list of an archive's members can be a thousand times as large as the arrays of a model.
"""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from io import BytesIO
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..limits import MAX_FILE_BYTES

__all__ = ["arrays_of"]

#: End of a zip archive without a comment: size of the list of members, and where it begins.
END = struct.Struct("<4s4H2LH")
#: Size of what stands before it in archives of more than 4 GB.
LOCATOR_BYTES = 20
#: Bytes of the list of members: a dozen with names of a dozen letters need a thousandth.
MAX_LIST_BYTES = 2**16
#: Start of an array as NumPy writes it: version 1.0, length of the rest, kind and size of numbers, order, shape.
HEADER = re.compile(
    rb"\x93NUMPY\x01\x00..\{'descr': '([<>|](?:b1|[iuf]\d{1,2}))', 'fortran_order': (True|False), "
    rb"'shape': \(((?:\d{1,12}(?:, |,)?){0,4})\), \} *\n",
    re.DOTALL,
)
#: Bytes of it up to the length.
PREFIX = 10
#: What the archive's reader raises on files that are none.
DAMAGED = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, IndexError)


def arrays_of(data: bytes) -> dict[str, NDArray[Any]]:
    """Arrays of numbers and truth values by name.

    Raises
    ------
    InputError
        On a damaged archive, on arrays of objects, and when it unpacks to more than a file may have.
    """
    _check_list(data)
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            if sum(member.file_size for member in members) > MAX_FILE_BYTES:
                raise InputError(f"unpacks to more than {MAX_FILE_BYTES // 2**20} MB, the most that is read; split it")
            return {member.filename.removesuffix(".npy"): _array(archive, member) for member in members}
    except InputError:
        raise
    except (*DAMAGED, ValueError, RuntimeError) as error:
        raise InputError(
            f"damaged archive ({str(error)[:200] or type(error).__name__}); write the file again"
        ) from None


def _check_list(data: bytes) -> None:
    """Refuse archives with a list of members that no model has, before it is read."""
    if len(data) < END.size:
        raise InputError("the archive is cut off; write the file again")
    signature, _, _, _, _, size, _, comment = END.unpack(data[-END.size :])
    large = data[-END.size - LOCATOR_BYTES :].startswith(b"PK\x06\x07")
    if signature != b"PK\x05\x06" or comment or large:
        raise InputError("the archive is cut off, or has a comment or a size that NumPy does not write; write it again")
    if size > MAX_LIST_BYTES:
        raise InputError(f"the list of the archive's members has {size} bytes, a model's less than {MAX_LIST_BYTES}")


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> NDArray[Any]:
    name = member.filename[:40]
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(f"the member {name!r} is packed in a way that NumPy does not use; write the file again")
    with archive.open(member) as packed:
        # Not without a size: what is there could unpack to a thousand times what is stated, before it is cut.
        content = packed.read(member.file_size)
    # By its length: the first number may begin with the byte of a line's end.
    header = HEADER.fullmatch(content, 0, PREFIX + int.from_bytes(content[PREFIX - 2 : PREFIX], "little"))
    if header is None:
        raise InputError(f"the member {name!r} is not an array of numbers as NumPy writes them; write the file again")
    try:
        dtype = np.dtype(header[1].decode())
    except TypeError:
        raise InputError(f"the array {name!r} holds {header[1].decode()}, which is no kind of number") from None
    shape = [int(n) for n in header[3].replace(b",", b" ").split()]
    size = len(content) - header.end()
    if prod(shape) * dtype.itemsize != size:
        raise InputError(f"the array {name!r} has {size} bytes, not those of its shape; write the file again")
    # Truth values of other bytes than 0 and 1 are counted wrongly.
    numbers = np.frombuffer(content, np.uint8 if dtype.kind == "b" else dtype, offset=header.end())
    return (numbers != 0 if dtype.kind == "b" else numbers).reshape(shape, order="F" if header[2] == b"True" else "C")
