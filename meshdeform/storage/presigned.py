"""S3's own signed URLs with the headers that the answer shall carry (AWS Signature Version 4, query parameters).

obstore signs no parameters of its caller's. Its URL is taken as it is, the parameters are added, and it is signed
again, but only with a secret that is proved to be the one it was signed with.
"""

from __future__ import annotations

import hashlib
import hmac
from urllib.parse import parse_qsl, quote, urlencode, urlsplit, urlunsplit

__all__ = ["with_answer_headers"]

_SIGNATURE = "X-Amz-Signature"


def with_answer_headers(url: str, method: str, answer: dict[str, str], secret: str | None) -> str:
    """A signed URL whose answer carries headers of our choice.

    Parameters
    ----------
    url : str
        Signed by obstore.
    method : str
    answer : dict
        Headers of the answer, in S3's names for them: `response-content-type`, `response-content-disposition`.
    secret : str or None
        The secret access key, where it is known.

    Returns
    -------
    str
        `url` as it was, where the secret is not the one that signed it.
    """
    parts = urlsplit(url)
    pairs = parse_qsl(parts.query, keep_blank_values=True)
    signature = dict(pairs).get(_SIGNATURE)
    pairs = [(name, value) for name, value in pairs if name != _SIGNATURE]
    if not answer or not secret or signature is None:
        return url
    if not hmac.compare_digest(signature, _sign(method, parts.netloc, parts.path, pairs, secret)):
        return url
    pairs += answer.items()
    signature = _sign(method, parts.netloc, parts.path, pairs, secret)
    query = urlencode([*pairs, (_SIGNATURE, signature)], quote_via=quote, safe="")
    return urlunsplit(parts._replace(query=query))


def _sign(method: str, host: str, path: str, pairs: list[tuple[str, str]], secret: str) -> str:
    values = dict(pairs)
    _, date, region, service, terminal = values["X-Amz-Credential"].rsplit("/", 4)
    query = urlencode(sorted(pairs), quote_via=quote, safe="")
    request = "\n".join([method, path, query, f"host:{host}", "", "host", "UNSIGNED-PAYLOAD"])
    scope = "/".join([date, region, service, terminal])
    digest = hashlib.sha256(request.encode()).hexdigest()
    text = "\n".join([values["X-Amz-Algorithm"], values["X-Amz-Date"], scope, digest])
    key = f"AWS4{secret}".encode()
    for part in (date, region, service, terminal):
        key = hmac.new(key, part.encode(), hashlib.sha256).digest()
    return hmac.new(key, text.encode(), hashlib.sha256).hexdigest()
