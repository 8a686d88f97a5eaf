"""Send requests in an event loop, again where that may help, and receive streams."""

from __future__ import annotations

import contextlib
import inspect  # threads:
from collections.abc import AsyncIterator, Callable
from typing import Any, TypeVar

import anyio  # threads: import time
import httpx
from pydantic import BaseModel

from meshdeform.client.documents import read
from meshdeform.client.orders import UploadProgress
from meshdeform.client.problems import error_of
from meshdeform.client.requests import Answer, Call, Endpoint
from meshdeform.client.retries import Patience, Policy, unanswered, worth_a_retry
from meshdeform.errors import IdempotencyBusyError, MeshdeformError

M = TypeVar("M", bound=BaseModel)
T = TypeVar("T")


class AsyncConnection:
    """The connections to one service, which tasks may share."""

    def __init__(
        self,
        http: httpx.AsyncClient,
        endpoint: Endpoint,
        policy: Policy,
        on_upload: Callable[[UploadProgress], Any] | None = None,
    ) -> None:
        self._http, self._endpoint, self.policy, self.on_upload = http, endpoint, policy, on_upload

    async def send(self, call: Call) -> Answer:
        """Send a request once, and return the response with its body."""
        auth = httpx.Auth() if call.signed else httpx.USE_CLIENT_DEFAULT
        response = await self._http.send(self._endpoint.request(self._http, call), auth=auth, follow_redirects=False)
        return self._endpoint.answer(response, response.content)

    @contextlib.asynccontextmanager
    async def stream(self, call: Call) -> AsyncIterator[tuple[Answer, AsyncIterator[bytes]]]:
        """Send a request once, and yield the response and the pieces of its body as they arrive."""
        request = self._endpoint.request(self._http, call)
        response = await self._http.send(request, stream=True, follow_redirects=False)
        try:
            problem = b"" if response.is_success else await response.aread()
            yield self._endpoint.answer(response, problem), response.aiter_raw()
        finally:
            with shielded():
                await response.aclose()

    async def answered(self, call: Call, patience: Patience | None = None) -> Answer:
        """Send a request, with retries, and return the response. It must be safe to send more than once."""
        policy = self.policy
        patience = patience or Patience(policy, retries=policy.max_retries, seconds=policy.timeout_s)
        busy = Patience(policy, retries=None if policy.max_retries else 0, seconds=policy.busy_s)
        lost = False
        while True:
            error: MeshdeformError
            try:
                answer = await self.send(call)
            except httpx.HTTPError as failure:
                error, lost = unanswered(failure, call.url), True
            else:
                if answer.ok:
                    return answer
                if lost and call.method == "DELETE" and answer.status == 404:
                    return answer  # the first request succeeded, but its response was lost
                error = error_of(answer)
                if not worth_a_retry(error):
                    raise error
            await pause((busy if isinstance(error, IdempotencyBusyError) else patience).pause(error))

    async def document(self, model: type[M], call: Call) -> M:
        """Send a request, with retries, and return the document of the response; errors are those of `answered`."""
        answer = await self.answered(call)
        return read(model, answer.json(), answer.url)


async def pause(seconds: float) -> None:
    """Wait for a number of seconds."""
    await anyio.sleep(seconds)  # threads: time.sleep(seconds)


async def work(function: Callable[..., T], *arguments: Any) -> T:
    """Call a function that may block on the disk."""
    return await anyio.to_thread.run_sync(function, *arguments)  # threads: return function(*arguments)


async def tell(callback: Callable[[T], Any], value: T) -> None:
    """Call the user's function, which may be a coroutine function."""
    returned = callback(value)  # threads: callback(value)
    if inspect.isawaitable(returned):  # threads:
        await returned  # threads:


def shielded(seconds: float | None = None) -> contextlib.AbstractContextManager[object]:
    """Return a block that is completed, within a number of seconds, even if the caller is being canceled."""
    return anyio.move_on_after(seconds, shield=True)  # threads: return contextlib.nullcontext(seconds)
