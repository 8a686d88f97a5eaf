"""Sign and verify URLs for a store that only the API serves: HMAC-SHA256 over method, path, expiry and parameters.

The holder of such a URL may use one method on one path until it expires. The URL cannot be changed: added, removed or
repeated parameters are refused like a wrong signature.
"""

from __future__ import annotations

import hashlib
import hmac
import time
from collections.abc import Mapping
from urllib.parse import parse_qsl, urlencode

from meshdeform.errors import ForbiddenError

_DOMAIN = "meshdeform signed url 1"
_EXPIRES, _SIGNATURE = "expires", "signature"
_SECRET_BYTES = 16


def sign_path(
    method: str, path: str, expires_at: int, secret: bytes, parameters: Mapping[str, str] | None = None
) -> str:
    """Return a signed query, without a question mark, that permits `method` on `path`.

    `path`: as the server sees it: decoded, with the leading slash, without the query; `expires_at`: unix time in
    seconds from which the URL is refused; `secret`: at least 16 bytes, the same for every process that verifies.
    `parameters`: more query parameters to sign. None may be named `expires` or `signature`.
    """
    if parameters and {_EXPIRES, _SIGNATURE} & set(parameters):
        raise ValueError("parameters must not be named expires or signature")
    pairs = [*sorted((parameters or {}).items()), (_EXPIRES, str(int(expires_at)))]
    return urlencode([*pairs, (_SIGNATURE, _signature(method, path, pairs, secret))])


def verify_path(method: str, path: str, query: str, secret: bytes, now: float | None = None) -> dict[str, str]:
    """Verify that a complete query, as received, was signed for this method and path and has not expired.

    Returns the signed parameters, without `expires` and `signature`. `now` is a Unix time in seconds. Raises
    ForbiddenError: the signature is wrong, or the URL has expired.
    """
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True, errors="strict", max_num_fields=32)
    except ValueError as error:
        raise _refused() from error
    values = dict(pairs)
    signature, expires = values.pop(_SIGNATURE, ""), values.pop(_EXPIRES, "")
    bound = [*sorted(values.items()), (_EXPIRES, expires)]
    # Require the exact signed query: no parameter twice, none in another order.
    if len(pairs) != len(bound) + 1 or [name for name, _ in pairs] != [*(name for name, _ in bound), _SIGNATURE]:
        raise _refused()
    if not hmac.compare_digest(signature.encode(), _signature(method, path, bound, secret).encode()):
        raise _refused()
    if (time.time() if now is None else now) >= int(expires):
        raise ForbiddenError("The signed URL has expired.", advice="Request a new one.")
    return values


def _signature(method: str, path: str, pairs: list[tuple[str, str]], secret: bytes) -> str:
    if len(secret) < _SECRET_BYTES:
        raise ValueError(f"a secret must have at least {_SECRET_BYTES} bytes")
    # Each line is percent-encoded or free of newlines, so that different requests give different texts.
    text = "\n".join([_DOMAIN, method, urlencode({"path": path}), urlencode(pairs)])
    return hmac.new(secret, text.encode(), hashlib.sha256).hexdigest()


def _refused() -> ForbiddenError:
    return ForbiddenError("The URL's signature does not match the request.", advice="Request a new signed URL.")
