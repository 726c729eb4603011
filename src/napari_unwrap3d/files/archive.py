"""What a project file may hold, checked before anything in it is decoded or allocated.

A project may come from anywhere. Nothing in it is unpickled, run or unpacked to disk: it
is a zip of stored entries, which are either JSON (``zarr.json``) or Blosc chunks of arrays
of numbers. Whatever else is in it is refused, and so are sizes that the file cannot hold.
"""

from __future__ import annotations

import json
import math
import stat
import struct
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import PurePosixPath
from typing import Any

import numpy as np

from ..errors import FileFormatError, UnsafeFileError

NODE = "zarr.json"
NUMBERS = frozenset(
    ["bool", "float16", "float32", "float64", "complex64", "complex128"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)
CODECS = ["bytes", "blosc"]
LONGEST_EXTRA = 32  # the sizes of an entry beyond 4 GiB
LARGEST_JSON = 32 * 2**20
# Empty masks shrink 10 000 times, whole projects 2 to 20 times.
LARGEST_RATIO = 1000
ALWAYS_ALLOWED = 256 * 2**20
BLOSC_HEADER = struct.Struct("<4B3I")  # versions, flags, size of items; bytes, of a block, stored

HINT = "The file is damaged or was not written by napari-unwrap3d: get it anew from its source."


# Entries ---------------------------------------------------------------------


def check_entries(archive: zipfile.ZipFile, size: int) -> None:
    """Raise unless every entry is a plain stored file inside the archive.

    Parameters
    ----------
    archive : ZipFile
    size : int
        Bytes of the file.

    Raises
    ------
    UnsafeFileError
        A name leaves the archive or comes twice; an entry is a link, encrypted, compressed
        by the zip, or reaches over others.
    """
    entries = archive.infolist()
    for entry in entries:
        name = entry.filename
        parts = name.removesuffix("/").split("/")
        if name.startswith("/") or "\\" in name or ":" in parts[0] or {"", ".", ".."} & {*parts}:
            raise UnsafeFileError(f"The entry {name!r} leaves the archive.", hint=HINT)
        if stat.S_ISLNK(entry.external_attr >> 16):
            raise UnsafeFileError(f"The entry {name!r} is a link.", hint=HINT)
        if entry.comment or len(entry.extra) > LONGEST_EXTRA:
            # A damaged length makes an entry swallow those that follow it.
            raise UnsafeFileError(f"The entry {name!r} carries more than its content.", hint=HINT)
        if entry.flag_bits & 1:
            raise UnsafeFileError(f"The entry {name!r} is encrypted.", hint=HINT)
        if entry.compress_type != zipfile.ZIP_STORED or entry.file_size != entry.compress_size:
            raise UnsafeFileError(
                f"The entry {name!r} is compressed by the zip; those of a project never are.",
                declared_bytes=entry.file_size,
                stored_bytes=entry.compress_size,
                hint="Do not unpack and pack projects again; get the file anew from its source.",
            )
    if len({entry.filename for entry in entries}) < len(entries):
        raise UnsafeFileError("A name comes twice.", entries=len(entries), hint=HINT)
    stored = sum(entry.compress_size for entry in entries)
    if stored > size:
        raise UnsafeFileError(
            "The entries are larger than the file.", entry_bytes=stored, file_bytes=size, hint=HINT
        )


def read_node(archive: zipfile.ZipFile, name: str) -> dict[str, Any]:
    """The JSON of one ``zarr.json``."""
    length = archive.getinfo(name).file_size
    if length > LARGEST_JSON:
        raise UnsafeFileError(f"{name!r} is too large.", bytes=length, limit=LARGEST_JSON)
    node = json.loads(archive.read(name))
    if not isinstance(node, dict) or not isinstance(node.get("attributes", {}), dict):
        raise FileFormatError(f"{name!r} is no Zarr node.", hint=HINT)
    return node


# Groups and arrays -----------------------------------------------------------


def check_layout(archive: zipfile.ZipFile, size: int) -> None:
    """Raise unless the entries are exactly the groups and arrays that they declare.

    Nothing is decoded: the sizes come from the JSON and from the headers of the chunks.

    Parameters
    ----------
    archive : ZipFile
        Checked by :func:`check_entries`.
    size : int
        Bytes of the file.

    Raises
    ------
    UnsafeFileError
        An array is not of numbers, uses another codec, or declares more than it can hold.
    FileFormatError
        Parts are missing, or there are parts that belong to nothing.
    """
    entries = {entry.filename: entry.file_size for entry in archive.infolist()}
    names = [name for name in entries if PurePosixPath(name).name == NODE]
    nodes = {name.removesuffix(NODE).removesuffix("/"): read_node(archive, name) for name in names}
    known, declared = set(names), 0
    for path, node in nodes.items():
        parent = "" if "/" not in path else path.rsplit("/", 1)[0]
        if path and nodes.get(parent, {}).get("node_type") != "group":
            raise FileFormatError(f"{path!r} belongs to no group.", hint=HINT)
        if node.get("zarr_format") != 3 or node.get("consolidated_metadata"):
            raise UnsafeFileError(f"{path!r} is not stored as a project stores it.", hint=HINT)
        if node.get("node_type") == "group":
            continue
        count, chunk_bytes = _check_array(path, node)
        declared += count * chunk_bytes
        limit = max(ALWAYS_ALLOWED, LARGEST_RATIO * size)
        if declared > limit:
            raise UnsafeFileError(
                f"The array {path!r} declares more than a file of this size can hold.",
                declared_bytes=declared,
                file_bytes=size,
                limit=limit,
                hint=HINT,
            )
        known |= _check_chunks(archive, entries, path, node, chunk_bytes)
    unknown = sorted(entries.keys() - known)
    if unknown:
        raise FileFormatError(
            f"The archive holds what belongs to no array: {unknown[0]!r}.",
            entries=len(unknown),
            hint=HINT,
        )


def _check_array(path: str, node: Mapping[str, Any]) -> tuple[int, int]:
    """The number of chunks and the bytes of each, of an array as a project stores it."""
    codecs = [codec.get("name") for codec in node["codecs"]]
    if codecs != CODECS or node.get("storage_transformers"):
        raise UnsafeFileError(
            f"The array {path!r} is not stored as a project stores it.",
            codecs=", ".join(str(codec) for codec in codecs),
            hint=HINT,
        )
    attributes, shape = node["attributes"], node["shape"]
    chunk = node["chunk_grid"]["configuration"]["chunk_shape"]
    kinds = {str(node["data_type"]), str(attributes["dtype"])}
    if kinds - NUMBERS or len({np.dtype(kind).itemsize for kind in kinds}) > 1:
        raise UnsafeFileError(f"The array {path!r} holds no numbers.", type=", ".join(kinds))
    plain = all(type(n) is int and n >= 0 for n in [*shape, *chunk])
    whole = plain and chunk[1:] == [max(n, 1) for n in shape[1:]]
    if not whole or (shape and not 1 <= chunk[0] <= max(shape[0], 1)) or len(shape) != len(chunk):
        raise UnsafeFileError(f"The array {path!r} is cut in an unknown way.", hint=HINT)
    if set(attributes["differences"]) - set(range(len(shape))):
        raise UnsafeFileError(f"The array {path!r} has axes that do not exist.", hint=HINT)
    itemsize = np.dtype(str(node["data_type"])).itemsize
    return _count(node), math.prod(chunk) * itemsize


def _count(node: Mapping[str, Any]) -> int:
    shape, chunk = node["shape"], node["chunk_grid"]["configuration"]["chunk_shape"]
    if 0 in shape:
        return 0
    # Chunks span every axis but the first.
    return -(-shape[0] // chunk[0]) if shape else 1


def _check_chunks(
    archive: zipfile.ZipFile,
    entries: Mapping[str, int],
    path: str,
    node: Mapping[str, Any],
    chunk_bytes: int,
) -> set[str]:
    """The entries of an array, each of which decodes to exactly the bytes of a chunk."""
    count = _count(node)
    keys = set(_keys(path, len(node["shape"]), min(count, len(entries))))
    missing = count - len(keys & entries.keys())
    if missing:
        # Zarr takes a chunk that is not there for zeros; here it is damage.
        raise FileFormatError(
            f"Parts of the array {path!r} are missing.",
            chunks=count,
            missing=missing,
            hint="The file is damaged: copy it again.",
        )
    for key in keys:
        with archive.open(key) as file:
            header = file.read(BLOSC_HEADER.size)
        fields = BLOSC_HEADER.unpack(header) if len(header) == BLOSC_HEADER.size else (0,) * 7
        if (fields[4], fields[6]) != (chunk_bytes, entries[key]):
            raise UnsafeFileError(
                f"The chunk {key!r} declares another size than its array.",
                declared_bytes=fields[4],
                expected_bytes=chunk_bytes,
                hint=HINT,
            )
    return keys


def _keys(path: str, ndim: int, count: int) -> Iterator[str]:
    for index in range(count):
        yield "/".join([path, "c", *([str(index)] + ["0"] * (ndim - 1) if ndim else [])])
