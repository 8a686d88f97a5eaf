"""Receive the forms of jobs: the document in memory, the files streamed to disk."""

from __future__ import annotations

import codecs
import hashlib
import itertools
import re
from collections.abc import AsyncIterator, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, Protocol
from urllib.parse import unquote

from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

from meshdeform.api.limits import MAX_DOCUMENT_BYTES, MAX_FILENAME
from meshdeform.errors import AssetTooLargeError, KindRetiredError, RequestError
from meshdeform.requests.choices import RETIRED_FIELDS
from meshdeform.runs import file_fields

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks


DOCUMENT = "request"
_MAX_HEADER_BYTES = 8 * 1024
_MOST_FIELDS = 250
_QUOTED = re.compile(rb'"(?:[^"\\]|\\.)*"')
_JOB_ADVICE = (
    "Send the file as the field `asset` and the JSON document as the field `request`: "
    """curl -F asset=@FILE -F 'request={"prompt": "a mushroom"}' URL."""
)
_EXTENDED_NAME = re.compile(rb";\s*filename\*\s*=\s*([a-z0-9._-]+)'[^']*'([^;\s]+)", re.IGNORECASE)


@dataclass(frozen=True)
class ReceivedFile:
    """A received file on disk: the sender's name for it, without folders, its bytes, its SHA-256 (hexadecimal)."""

    path: Path
    filename: str
    size: int
    sha256: str


@dataclass(frozen=True)
class FormFiles:
    """The fields of files that a form may have, those of them that may be repeated, and advice on how to send it."""

    names: Collection[str]
    advice: str
    repeated: Collection[str] = ()


def job_files() -> FormFiles:
    """Return the fields of files of the forms of jobs of all kinds."""
    return FormFiles(file_fields(), _JOB_ADVICE)


async def receive_form(
    content_type: str,
    content_length: str,
    stream: AsyncIterator[bytes],
    folder: Path,
    max_bytes: int,
    known: FormFiles | None = None,
) -> tuple[bytes, dict[str, ReceivedFile]]:
    """Receive the field `request`, unparsed, and the files by field; by default those of every kind of job.

    Files of a repeated field are named NAME, NAME_2, NAME_3 and so on.
    """
    known = known or job_files()
    if content_length.isdigit() and int(content_length) > max_bytes:
        raise AssetTooLargeError.more_than(max_bytes, "The body has")
    kind, options = parse_options_header(content_type)
    boundary = options.get(b"boundary", b"")
    if kind != b"multipart/form-data" or not boundary:
        raise RequestError("The body is not multipart/form-data.", advice=known.advice)
    receiver = _Receiver(folder, known)
    received = 0
    try:
        parser = MultipartParser(boundary, receiver.callbacks())
        async for chunk in stream:
            received += len(chunk)
            if received > max_bytes:
                raise AssetTooLargeError.more_than(max_bytes, "The body has")
            parser.write(chunk)
        parser.finalize()
    except FormParserError as error:
        raise RequestError(f"The multipart body is malformed: {error}.") from error
    finally:
        receiver.close()
    return receiver.form()


class _Receiver:
    """Handle the parser's events and collect the fields."""

    def __init__(self, folder: Path, known: FormFiles) -> None:
        self._folder, self._known = folder, known
        self._headers: dict[str, bytes] = {}
        self._name, self._value = b"", b""
        self._current: _Field | None = None
        self._fields: dict[str, _Field] = {}
        self._ended = False

    def callbacks(self) -> MultipartCallbacks:
        return {
            "on_part_begin": self._on_part_begin,
            "on_header_field": self._on_header_field,
            "on_header_value": self._on_header_value,
            "on_header_end": self._on_header_end,
            "on_headers_finished": self._on_headers_finished,
            "on_part_data": self._on_part_data,
            "on_part_end": self._on_part_end,
            "on_end": self._on_end,
        }

    def form(self) -> tuple[bytes, dict[str, ReceivedFile]]:
        if not self._ended:
            raise RequestError("The body ends without the final boundary.", advice="Send the whole body.")
        if DOCUMENT not in self._fields:
            raise RequestError(f"The field `{DOCUMENT}` is missing.", advice=self._known.advice)
        document = self._fields[DOCUMENT]
        assert isinstance(document, _DocumentField)
        files = {name: field.file() for name, field in self._fields.items() if isinstance(field, _FileField)}
        return bytes(document.data), files

    def close(self) -> None:
        for field in self._fields.values():
            field.close()

    def _on_part_begin(self) -> None:
        self._headers = {}

    def _on_header_field(self, data: bytes, start: int, end: int) -> None:
        self._name = _joined(self._name, data[start:end])

    def _on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._value = _joined(self._value, data[start:end])

    def _on_header_end(self) -> None:
        self._headers[self._name.decode("latin-1").lower()] = self._value
        self._name, self._value = b"", b""

    def _on_headers_finished(self) -> None:
        disposition = self._headers.get("content-disposition", b"")
        _, options = parse_options_header(disposition)
        name = options.get(b"name", b"").decode("utf-8", "replace")
        known = sorted((*self._known.names, DOCUMENT))
        if name in RETIRED_FIELDS.difference(known):
            raise KindRetiredError(f"The field {name!r} was for lessons and what they taught.")
        if name not in known:
            advice = f"The fields are {', '.join(known[:-1])} and {known[-1]}."
            raise RequestError(f"Unknown field {name[:100]!r}.", advice=advice)
        if name in self._fields and name not in self._known.repeated:
            raise RequestError(f"The field `{name}` was sent twice.", advice="Send it once.")
        if len(self._fields) >= _MOST_FIELDS:
            raise RequestError(f"The form has more than {_MOST_FIELDS} fields.", advice="Send the meshes as one ZIP.")
        name = next(each for each in _numbered(name) if each not in self._fields)
        if name == DOCUMENT:
            self._current = _DocumentField()
        else:
            self._current = _FileField(self._folder / name, clean_filename(_filename(disposition, options)))
        self._fields[name] = self._current

    def _on_part_data(self, data: bytes, start: int, end: int) -> None:
        assert self._current is not None
        self._current.write(data[start:end])

    def _on_part_end(self) -> None:
        if self._current is not None:
            self._current.close()

    def _on_end(self) -> None:
        self._ended = True


def _numbered(name: str) -> Iterator[str]:
    return itertools.chain([name], (f"{name}_{number}" for number in itertools.count(2)))


class _Field(Protocol):
    def write(self, data: bytes) -> None: ...
    def close(self) -> None: ...


class _DocumentField:
    def __init__(self) -> None:
        self.data = bytearray()

    def write(self, data: bytes) -> None:
        if len(self.data) + len(data) > MAX_DOCUMENT_BYTES:
            raise RequestError(f"The field `{DOCUMENT}` is longer than {MAX_DOCUMENT_BYTES} bytes.")
        self.data += data

    def close(self) -> None:
        pass


class _FileField:
    def __init__(self, path: Path, filename: str) -> None:
        self.path, self.filename = path, filename
        self.size, self.digest = 0, hashlib.sha256()
        self._file: BinaryIO = path.open("wb")

    def write(self, data: bytes) -> None:
        self.size += len(data)
        self.digest.update(data)
        self._file.write(data)

    def close(self) -> None:
        self._file.close()

    def file(self) -> ReceivedFile:
        return ReceivedFile(self.path, self.filename, self.size, self.digest.hexdigest())


def _filename(header: bytes, options: Mapping[bytes, bytes]) -> str:
    """Return the name in a Content-Disposition: `filename*`, in its encoding, before `filename` (RFC 6266, 4.3)."""
    match = _EXTENDED_NAME.search(_QUOTED.sub(b'""', header))  # the parser drops this form
    if match is not None:
        charset = match[1].decode("ascii")
        with suppress(LookupError):
            codecs.lookup(charset)
            return unquote(match[2].decode("ascii", "replace"), charset, "replace")
    return options.get(b"filename", b"").decode("utf-8", "replace")


def clean_filename(filename: str) -> str:
    """Return the last component of a path without control characters. A long name keeps its end, with the suffix."""
    name = re.split(r"[/\\]", filename)[-1]
    return "".join(letter for letter in name if letter.isprintable())[-MAX_FILENAME:]


def _joined(header: bytes, data: bytes) -> bytes:
    if len(header) + len(data) > _MAX_HEADER_BYTES:
        raise RequestError(f"A field's header is longer than {_MAX_HEADER_BYTES} bytes.")
    return header + data
