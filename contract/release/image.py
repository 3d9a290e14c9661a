"""The flashed image of a release: a string of bytes that a boot loader in C can read without a library.

    0   8  "SWIMAGE1"
    8   4  length of the whole image
    12  4  number of files, n
    16     n entries: length of the name (2), length of the file (4), name (UTF-8)
           the files' contents, in the same order, without gaps

Numbers are big-endian. `manifest.json` and `manifest.sig` come first, so that the receiver of an image can check the
manifest before the rest arrives; the other files follow in the order of their names. Equal bundles have equal images.
"""

import struct
from collections.abc import Mapping
from typing import Final

from contract.errors import BundleContainerError
from contract.printable import quoted
from contract.release.checks import SIGNATURE
from contract.release.container import MAX_BYTES, MAX_FILES, is_plain_name
from contract.release.manifest import MANIFEST

MAGIC: Final = b"SWIMAGE1"
_HEADER: Final = struct.Struct(">8sII")
_ENTRY: Final = struct.Struct(">HI")
_FIRST: Final = (MANIFEST, SIGNATURE)


def image_of(files: Mapping[str, bytes]) -> bytes:
    """Build the image of a bundle's files; raises BundleContainerError for too many files or bytes."""
    if len(files) > MAX_FILES or sum(map(len, files.values())) > MAX_BYTES:
        raise BundleContainerError(f"image: more than {MAX_FILES} files or {MAX_BYTES} bytes")
    names = sorted(files, key=lambda name: (_FIRST.index(name) if name in _FIRST else len(_FIRST), name))
    entries = b"".join(_ENTRY.pack(len(name.encode()), len(files[name])) + name.encode() for name in names)
    contents = b"".join(files[name] for name in names)
    return _HEADER.pack(MAGIC, _HEADER.size + len(entries) + len(contents), len(names)) + entries + contents


def files_of(image: bytes) -> dict[str, bytes]:
    """Return an image's files by name. Raises BundleContainerError for anything but an image of plain files."""
    if len(image) < _HEADER.size:
        raise BundleContainerError(f"image of {len(image)} bytes: must have {_HEADER.size} or more")
    magic, length, count = _HEADER.unpack_from(image)
    if magic != MAGIC:
        raise BundleContainerError(f"image begins with {magic.hex()}: must begin with {MAGIC.hex()}")
    if length != len(image):
        raise BundleContainerError(f"image of {len(image)} bytes states a length of {length}")
    if count > MAX_FILES:
        raise BundleContainerError(f"image of {count} files: at most {MAX_FILES}")
    names, sizes, at = [], [], _HEADER.size
    for _ in range(count):
        if at + _ENTRY.size > length:
            raise BundleContainerError("image ends within its list of files")
        name_length, size = _ENTRY.unpack_from(image, at)
        at += _ENTRY.size
        try:
            name = image[at : at + name_length].decode()
        except UnicodeDecodeError as error:
            raise BundleContainerError("image: a file's name is not UTF-8") from error
        if len(name.encode()) != name_length or not is_plain_name(name) or name in names:
            raise BundleContainerError(f"image: {quoted(name)} must be a plain file name, and must occur once")
        names.append(name)
        sizes.append(size)
        at += name_length
    if at + sum(sizes) != length:
        raise BundleContainerError(f"image of {length} bytes: its files end at {at + sum(sizes)}")
    found = {}
    for name, size in zip(names, sizes, strict=True):
        found[name] = image[at : at + size]
        at += size
    return found
