"""Our own signed URLs, for a store that nobody else serves: HMAC-SHA256 over method, path, expiry and every parameter.

Whoever holds such a URL may do one thing to one path until it expires. Nothing of it can be changed: a parameter that
was added, removed or repeated is refused like a wrong signature.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Mapping
from urllib.parse import parse_qsl, urlencode

from meshdeform.errors import ForbiddenError

__all__ = ["sign_path", "verify_path"]

_DOMAIN = "meshdeform signed url 1"
_EXPIRES, _SIGNATURE = "expires", "signature"
_SECRET_BYTES = 16


def sign_path(
    method: str, path: str, expires_at: int, secret: bytes, parameters: Mapping[str, str] | None = None
) -> str:
    """The query that lets its bearer do something to a path.

    Parameters
    ----------
    method : str
        As in the request: `GET`, `PUT`.
    path : str
        As the server sees it: decoded, with the leading slash, without the query.
    expires_at : int
        Unix time, seconds; from then on the URL is refused.
    secret : bytes
        At least 16; the same for every process that verifies.
    parameters : mapping, optional
        More of the query, bound like the rest; none is called `expires` or `signature`.

    Returns
    -------
    str
        Without a question mark.
    """
    if parameters and {_EXPIRES, _SIGNATURE} & set(parameters):
        raise ValueError("these names are the signature's own")
    pairs = [*sorted((parameters or {}).items()), (_EXPIRES, str(int(expires_at)))]
    return urlencode([*pairs, (_SIGNATURE, _signature(method, path, pairs, secret))])


def verify_path(method: str, path: str, query: str, secret: bytes, now: float | None = None) -> dict[str, str]:
    """Return when the query was signed for this method and this path and has not expired.

    Parameters
    ----------
    method, path, secret
        As for `sign_path`.
    query : str
        All of the request's query, as it came.
    now : float, optional
        Unix time, seconds; the clock's unless given.

    Returns
    -------
    dict
        The signed parameters, without `expires` and `signature`.

    Raises
    ------
    ForbiddenError
        It was not, or it has.
    """
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True, errors="strict", max_num_fields=32)
    except ValueError as error:
        raise _refused() from error
    values = dict(pairs)
    given, expires = values.pop(_SIGNATURE, ""), values.pop(_EXPIRES, "")
    bound = [*sorted(values.items()), (_EXPIRES, expires)]
    # The whole query in the form in which it was signed: nothing twice, nothing in another order.
    if len(pairs) != len(bound) + 1 or [name for name, _ in pairs] != [*(name for name, _ in bound), _SIGNATURE]:
        raise _refused()
    if not hmac.compare_digest(given.encode(), _signature(method, path, bound, secret).encode()):
        raise _refused()
    if (time.time() if now is None else now) >= int(expires):
        raise ForbiddenError("The signed URL has expired.", advice="Ask for a new one.")
    return values


def _signature(method: str, path: str, pairs: list[tuple[str, str]], secret: bytes) -> str:
    if len(secret) < _SECRET_BYTES:
        raise ValueError(f"a secret has at least {_SECRET_BYTES} bytes")
    # Each part percent-encoded by itself or free of line ends: no two different requests give the same text.
    text = "\n".join([_DOMAIN, method, urlencode({"path": path}), urlencode(pairs)])
    return hmac.new(secret, text.encode(), hashlib.sha256).hexdigest()


def _refused() -> ForbiddenError:
    return ForbiddenError("The signature of the URL does not fit the request.", advice="Ask for a new signed URL.")
