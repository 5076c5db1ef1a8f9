"""Writes and reads the archive of an agent file: a zip of three members, not compressed, each with its checksum.

What a zip file may hold besides is refused: other names, links, comments, encryption, compression. So no path in it
is ever followed, and nothing grows when it is read.
"""

from __future__ import annotations

import hashlib
import stat
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import IO
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from sb3_bruno.export.limits import LARGEST_TENSORS, LARGEST_TEXT
from sb3_bruno.files.shown import shown
from sb3_bruno.files.whole import whole_file

AGENT, TENSORS, SUMS = "agent.json", "tensors.safetensors", "SHA256SUMS"
LARGEST = {AGENT: LARGEST_TEXT, TENSORS: LARGEST_TENSORS, SUMS: LARGEST_TEXT}
"""The members, and how many bytes each may have."""
_END = struct.Struct("<4s4H2LH")  # the record at the end of a zip file
_HEAD = struct.Struct("<4s5H3L2H")  # the record before a member, without the name that follows
_ZIP64 = b"PK\x06\x07"
_DATE = (1980, 1, 1, 0, 0, 0)  # the first that a zip file knows, so that the same agent makes the same bytes


def write_archive(path: Path, agent: bytes, tensors: bytes) -> None:
    """Write an agent file, whole or not at all.

    Raises:
        ValueError: if it would be too large to be read again.
    """
    content = {AGENT: agent, TENSORS: tensors}
    for name, data in content.items():
        if len(data) > LARGEST[name]:
            raise ValueError(f"{name} would have {len(data):,} bytes, and {LARGEST[name]:,} are allowed")
    with whole_file(path) as part, ZipFile(part, "w", ZIP_STORED) as archive:
        for name, data in {**content, SUMS: _sums(content)}.items():
            member = ZipInfo(name, _DATE)
            member.external_attr = (stat.S_IFREG | 0o644) << 16
            archive.writestr(member, data)


def read_archive(path: Path) -> tuple[bytes, bytes]:
    """Read an agent file.

    Returns:
        What ``write_archive`` was given.

    Raises:
        Exception: of any kind, if the file is not as ``write_archive`` makes it.
    """
    if path.is_dir():
        raise ValueError("it is a folder")
    if not path.is_file():  # neither a pipe nor a device, which may never end
        raise ValueError("there is no such file")
    with path.open("rb") as file:
        _check_end(file, path.stat().st_size)
        with ZipFile(file) as archive:
            members = archive.infolist()
            _check_members(members)
            _check_gaps(file, members, archive.start_dir)
            content = {member.filename: archive.read(member) for member in members}
    sums = content.pop(SUMS)
    if sums != _sums(content):
        raise ValueError(f"a checksum in {SUMS} is not that of its member, so the file was damaged or changed")
    return content[AGENT], content[TENSORS]


def _check_end(file: IO[bytes], size: int) -> None:
    """Refuse a zip file whose own table of contents is not short and at its very end, before Python reads it."""
    if not _END.size <= size <= sum(LARGEST.values()) + LARGEST_TEXT:
        raise ValueError(f"it has {size:,} bytes, as no agent file has")
    file.seek(-min(size, _END.size + 20), 2)
    tail = file.read()
    signature, disk, first_disk, n_here, n_members, length, start, n_comment = _END.unpack(tail[-_END.size :])
    is_whole = signature == b"PK\x05\x06" and start + length + _END.size == size and n_comment == 0
    if not is_whole or tail.startswith(_ZIP64) or (disk, first_disk) != (0, 0):
        raise ValueError("it is no zip file of ours, or was cut short")
    if n_here != n_members or n_members != len(LARGEST) or length > 1_000:
        raise ValueError(f"it does not hold exactly {', '.join(LARGEST)}")


def _check_members(members: list[ZipInfo]) -> None:
    names = [member.orig_filename for member in members]
    if sorted(names) != sorted(LARGEST) or names != [member.filename for member in members]:
        raise ValueError(f"it holds {', '.join(map(shown, names))}, and not exactly {', '.join(LARGEST)}")
    for member in members:
        kind = stat.S_IFMT(member.external_attr >> 16)
        if kind not in (0, stat.S_IFREG) or member.flag_bits or member.extra or member.comment:
            raise ValueError(f"{member.filename} is no plain member, but a link, encrypted, or with something attached")
        if member.compress_type != ZIP_STORED or member.compress_size != member.file_size:
            raise ValueError(f"{member.filename} is compressed, as no member of an agent file is")
        if member.file_size > LARGEST[member.filename]:
            raise ValueError(f"{member.filename} has {member.file_size:,} bytes, more than are allowed")


def _check_gaps(file: IO[bytes], members: list[ZipInfo], end: int) -> None:
    """Refuse bytes before, between and behind the members, in which anything might be.

    Example: members of 30 bytes of record, a name of 10 and 500 bytes of content begin at 0, 540 and 1080.
    """
    place = 0
    for member in sorted(members, key=lambda member: member.header_offset):
        file.seek(member.header_offset)
        *_, n_name, n_extra = _HEAD.unpack(file.read(_HEAD.size))
        if member.header_offset != place or n_extra:
            raise ValueError(f"it has something before {member.filename} that belongs to no member")
        place += _HEAD.size + n_name + member.file_size
    if place != end:
        raise ValueError("it has something behind its last member that belongs to none")


def _sums(content: Mapping[str, bytes]) -> bytes:
    """List the checksums of the members as ``sha256sum`` does, which so can check them."""
    lines = [f"{hashlib.sha256(content[name]).hexdigest()}  {name}\n" for name in (AGENT, TENSORS)]
    return "".join(lines).encode()
