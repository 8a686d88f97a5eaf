"""Make and verify links, each of which lets whoever has it read one job.

A link is a bearer token, so it is in no address that a server sees, in no log and in no `Referer`: the page keeps it
behind the `#` of its own address. It is signed for the path of its job by `meshdeform.storage.signatures`, ends by
itself, and ends with the key that made it or with the job.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Annotated
from urllib.parse import parse_qs, urlencode

from anyio import to_thread
from fastapi import Depends, Request
from fastapi.security.http import HTTPAuthorizationCredentials

from meshdeform.api.jobs import SignedUrl
from meshdeform.errors import ForbiddenError, UnauthorizedError, UnavailableError
from meshdeform.storage import sign_path, verify_path
from service.http.auth import BEARER, LINK_PREFIX, principal, sent_key
from service.state import AppState, AppStateDep

SIGNING_KEY = "signed-urls"
"""The name of the record's secret that signs URLs and links."""
_LONGEST_S = 7 * 86_400  # the longest lifetime that S3 accepts for a signed URL


@dataclass(frozen=True)
class Viewer:
    """Who reads a job.

    The owner is None for the link to this very job, whoever owns it; `link` is the link's token, else empty.
    """

    owner_id: str | None
    link: str = ""

    @property
    def slot(self) -> str:
        """The name under which the streams of this reader are counted: those of a link are no owner's."""
        return self.link if self.owner_id is None else self.owner_id


def lifetime_s(app: AppState) -> int:
    """Return how long signed URLs and links are valid, in seconds."""
    return min(int(app.settings.signed_url_ttl_s), _LONGEST_S)


def job_link(app: AppState, job_id: str, key_id: str | None) -> SignedUrl:
    """Return the address of the page that shows a job to whoever has it; it ends with the API key that makes it."""
    until = int(time.time()) + lifetime_s(app)
    query = sign_path("GET", _path(job_id), until, app.record.secret(SIGNING_KEY), {"key": key_id or ""})
    signature = parse_qs(query)["signature"][0]
    token = f"{LINK_PREFIX}{until}.{key_id or ''}.{signature}"
    return SignedUrl(url=f"/#/shared/{job_id}/{token}", expires_at=datetime.fromtimestamp(until, UTC))


def verify_link(app: AppState, job_id: str, token: str) -> None:
    """Check that a link opens a job."""
    advice = "Ask whoever sent it for a new one."
    expires, _, rest = token.removeprefix(LINK_PREFIX).partition(".")
    key_id, _, signature = rest.partition(".")
    query = urlencode([("key", key_id), ("expires", expires), ("signature", signature)])
    try:
        verify_path("GET", _path(job_id), query, app.record.secret(SIGNING_KEY), now=0.0)
    except ForbiddenError as error:
        raise UnauthorizedError("The link does not open this job.", advice=advice) from error
    if time.time() >= int(expires):
        raise UnauthorizedError("The link has expired.", advice=advice)
    if key_id and not app.record.keys.is_active(key_id):
        raise UnauthorizedError("The link was withdrawn: the API key that made it was revoked.", advice=advice)


async def still_opens(app: AppState, job_id: str, token: str) -> bool:
    """Return whether a link that has opened a job still does, for requests that last."""
    try:
        await to_thread.run_sync(verify_link, app, job_id, token)
    except UnavailableError:
        return True
    except UnauthorizedError:
        return False
    return True


def _path(job_id: str) -> str:
    # No route has this path, so the signature opens nothing as a signed URL, and that of a signed URL is no link.
    return f"/v1/jobs/{job_id}/"


async def viewer(
    request: Request,
    app: AppStateDep,
    _documented: Annotated[HTTPAuthorizationCredentials | None, Depends(BEARER)],
) -> Viewer:
    """Return who reads the job of the path: the caller with its key, or the holder of a link to this job."""
    token = sent_key(request) or ""
    if not token.startswith(LINK_PREFIX):
        return Viewer((await principal(request, None)).owner_id)
    await to_thread.run_sync(verify_link, app, request.path_params["id"], token)
    return Viewer(None, token)


ViewerDep = Annotated[Viewer, Depends(viewer)]
"""Who reads a job, in routes that a link to it opens."""
