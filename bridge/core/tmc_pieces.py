"""Which parts of a class file can be read on their own, when the file as a whole is not well-formed.

Rule: bytes only and one pass. The file may be cut off, huge or hostile, so nothing here looks back, and no second copy of it is
made unless it is in another encoding than UTF-8.
"""

import codecs
import re
from collections.abc import Iterator
from typing import Final

_DECLARED: Final = re.compile(rb"(?:\xef\xbb\xbf)?<\?xml[^>]{0,200}?encoding=[\"']([A-Za-z0-9._-]{1,40})[\"']")


def utf8(data: bytes) -> bytes:
    """The file in UTF-8, by its mark or declaration. Bytes that are no text stay, or become a byte that no UTF-8 has."""
    declared = _DECLARED.match(data)
    encoding = declared[1].decode("ascii") if declared else "utf-8"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    try:
        if codecs.lookup(encoding).name == "utf-8":
            return data
        return data.decode(encoding, "replace").encode("utf-8", "replace").replace(b"\xef\xbf\xbd", b"\xff")
    except (LookupError, ValueError):
        return data


def is_utf8(piece: bytes) -> bool:
    """Whether the bytes are text in UTF-8."""
    try:
        piece.decode("utf-8")
    except UnicodeDecodeError:
        return False
    return True


_TOKEN: Final = re.compile(rb"<!--|-->|<!\[CDATA\[|\]\]>|<(/?)(DataType|Translations)(?:\s[^<>]*)?>")
_ENDS: Final = {b"<!--": b"-->", b"<![CDATA[": b"]]>"}


def pieces(text: bytes) -> Iterator[tuple[int, int, str]]:
    """Start, end and tag of each outermost DataType and Translations outside comments and CDATA; end -1 when not closed."""
    until: bytes | None = None
    opened: tuple[int, str] | None = None
    for match in _TOKEN.finditer(text):
        token, closing = match[0], match[1]
        if until is not None:
            until = None if token == until else until
            continue
        if match[2] is None:
            until = _ENDS.get(token)
            continue
        tag = match[2].decode("ascii")
        if closing:
            if opened is not None and opened[1] == tag:
                yield opened[0], match.end(), tag
                opened = None
        elif opened is None or tag == "DataType":
            if opened is not None:
                yield opened[0], -1, opened[1]
            opened = None if token.endswith(b"/>") else (match.start(), tag)
    if opened is not None:
        yield opened[0], -1, opened[1]
