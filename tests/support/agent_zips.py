"""Takes an agent file to pieces, changes them, and puts it together again, with the right checksums."""

import hashlib
import io
import json
import os
import stat
import struct
import zipfile

import safetensors.torch
import torch as th

from sb3_bruno.export.archive import AGENT, SUMS, TENSORS


class Bomb:
    """Pickled, it makes a folder when it is loaded."""

    def __reduce__(self):
        return os.mkdir, ("has_run",)


def members_of(good):
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def summed(members):
    """The members with the right checksums."""
    lines = [f"{hashlib.sha256(members[name]).hexdigest()}  {name}\n" for name in (AGENT, TENSORS) if name in members]
    return {**members, SUMS: "".join(lines).encode()}


def zipped(members, compression=zipfile.ZIP_STORED):
    """A zip file of members, which are bytes by name, or pairs of ZipInfo and bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for member, data in members.items() if isinstance(members, dict) else members:
            archive.writestr(member, data)
    return file.getvalue()


def with_json(good, change):
    """A file whose JSON was changed, with the right checksums. ``change`` edits it in place, or returns its text."""
    members = members_of(good)
    plain = json.loads(members[AGENT])
    changed = change(plain)
    text = changed if isinstance(changed, str | bytes) else json.dumps(plain)
    return zipped(summed({**members, AGENT: text if isinstance(text, bytes) else text.encode()}))


def with_tensors(good, change):
    """A file whose tensors were changed, with the right checksums. ``change`` edits them, or returns bytes."""
    members = members_of(good)
    tensors = safetensors.torch.load(members[TENSORS])
    changed = change(tensors)
    data = changed if isinstance(changed, bytes) else safetensors.torch.save(tensors)
    return zipped(summed({**members, TENSORS: data}))


def put(*path, value):
    """A change that puts a value deep into JSON."""

    def change(plain):
        for key in path[:-1]:
            plain = plain[key]
        plain[path[-1]] = value

    return change


def drop(*path):
    def change(plain):
        for key in path[:-1]:
            plain = plain[key]
        del plain[path[-1]]

    return change


def header(entries, data=b""):
    """A file of safetensors with any header."""
    text = json.dumps(entries).encode() if not isinstance(entries, bytes) else entries
    return struct.pack("<Q", len(text)) + text + data


def fill(name, number):
    def change(tensors):
        tensors[name].fill_(number)

    return change


def first_weight(tensors):
    return next(name for name, tensor in tensors.items() if name.startswith("policy.actor") and tensor.ndim == 2)


def replace_first(make):
    def change(tensors):
        name = first_weight(tensors)
        tensors[name] = make(tensors[name])

    return change


def info(name, mode=stat.S_IFREG | 0o644, **attributes):
    member = zipfile.ZipInfo(name)
    member.external_attr = mode << 16
    for attribute, value in attributes.items():
        setattr(member, attribute, value)
    return member


def renamed(good, old, new):
    members = members_of(good)
    return zipped({new if name == old else name: data for name, data in members.items()})


def with_info(good, name, member):
    """A file in which one member is written with a ZipInfo of its own."""
    return zipped([(member if known == name else known, data) for known, data in members_of(good).items()])


def patched(good, offset_from_table, value):
    """A file with other bytes at a place in the first entry of its table of contents."""
    at = good.index(b"PK\x01\x02") + offset_from_table
    return good[:at] + value + good[at + len(value) :]


def stuffed(good, before, junk=b"#!/bin/sh\n"):
    """A file with bytes that belong to no member, before one of the three or, for 3, the table, which tells so."""
    with zipfile.ZipFile(io.BytesIO(good)) as archive:
        offsets, start = [member.header_offset for member in archive.infolist()], archive.start_dir
    at = [*offsets, start][before]
    changed, place = bytearray(good), start
    for offset in offsets:
        struct.pack_into("<L", changed, place + 42, offset + len(junk) * (offset >= at))
        place = good.find(b"PK\x01\x02", place + 1)
    struct.pack_into("<L", changed, len(good) - 6, start + len(junk))
    return bytes(changed[:at] + junk + changed[at:])


def with_local_extra(good):
    """A file whose first member has something attached that the table of contents does not tell."""
    extra, begin, end = struct.pack("<2H4s", 0xCAFE, 4, b"hide"), 30 + len(AGENT), good.index(b"PK\x03\x04", 4)
    changed = bytearray(stuffed(good, 1, extra))
    changed[begin : end + len(extra)] = extra + changed[begin:end]
    struct.pack_into("<H", changed, 28, len(extra))
    return bytes(changed)


def with_zip64(good):
    """A file whose table of contents is told by a record of zip64 before its end."""
    end = len(good) - 22
    count, length, start = struct.unpack("<HLL", good[end + 10 : end + 20])
    record = struct.pack("<4sQ2H2L4Q", b"PK\x06\x06", 44, 45, 45, 0, 0, count, count, length, start)
    return good[:end] + record + struct.pack("<4sLQL", b"PK\x06\x07", 0, end, 1) + good[end:]


def bomb(good):
    """A file of a few kilobytes with a member that is larger than ``MOST_MEMORY``, written piece by piece."""
    members = members_of(good)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in (AGENT, SUMS):
            archive.writestr(name, members[name])
        with archive.open(TENSORS, "w") as member:
            for _ in range(120):
                member.write(bytes(2**20))
    return file.getvalue()


def saved_by_torch():
    file = io.BytesIO()
    th.save(Bomb(), file)
    return file.getvalue()
