"""Define the tools: what an agent can ask of a service, and the files that it may name."""

from __future__ import annotations

import asyncio
import base64
import binascii
import functools
import json
import os
import re
import sys
import tempfile
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Annotated, Any

from mcp.server.mcpserver import Context, Image
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, ValidationError

from meshdeform.client import AsyncClient, EventView, JobView, WaitTimeoutError
from meshdeform.errors import ForbiddenError, MeshdeformError, NotFoundError, ParameterError, readable_size
from meshdeform.requests.document import DeformParams, first_problem
from meshdeform.verdicts import read_verdict

Asset = Annotated[
    str,
    Field(
        description="A GLB, OBJ, PLY, STL or ZIP: a path, the id of an upload, or JOB_ID/result.glb for the result of "
        "an earlier job."
    ),
]
_PRESET = DeformParams.model_fields["preset"]
Params = Annotated[
    dict[str, Any] | None,
    Field(
        description='Parameters of the job, for example {"seed": 7}: another seed takes another design. With '
        '{"preset": "preview"} or {"guidance": {"kind": "sds"}} a model pushes the asset step by step instead; '
        f"preset (default: {_PRESET.default}): {_PRESET.description}"
    ),
]
JobId = Annotated[str, Field(description="The id that deform or fit_to_mesh returned.")]
Name = Annotated[str, Field(description="result.glb, report.json, preview.png or morph.glb.")]
_REPORT = "report.json"
_UPLOAD = re.compile(r"upl_[0-9a-z]{26}")
_JOB_FILE = re.compile(r"(job_[0-9a-z]{26})/([\w.-]+)")
_LONGEST_WAIT_S = 600.0
_UPLOAD_BYTES = 32 * 2**20
_INSPECTION_S = 120.0
_INSPECTIONS = 2  # at a time: each is a process with the numerical libraries


class Folders:
    """The folders of this machine in which an agent may read and write. Relative paths count from the first one.

    Without any, no path is accepted, as on a server that other machines reach.
    """

    def __init__(self, roots: Sequence[Path]) -> None:
        self.roots = [root.resolve() for root in roots]

    def source(self, name: str) -> Path | dict[str, str]:
        """Return an existing local file, or the reference that the service takes.

        The name is a path, the id of an upload, or `JOB/NAME`, an artifact of a job. `NotFoundError`: there is no such
        file; `ForbiddenError`: the path is outside the folders.
        """
        if _UPLOAD.fullmatch(name):
            return {"upload_id": name}
        if match := _JOB_FILE.fullmatch(name):
            return {"job_id": match[1], "artifact": match[2]}
        path = self._inside(name)
        if not path.is_file():
            raise NotFoundError(f"There is no file {name}.", advice=self._advice())
        return path

    def destination(self, name: str) -> Path:
        """Return where a new file may be written.

        `ForbiddenError`: it is outside the folders; `ParameterError`: its folder does not exist, or the name is taken.
        """
        path = self._inside(name)
        if not path.parent.is_dir():
            raise ParameterError(f"There is no folder {path.parent}.", advice="Name a file in an existing folder.")
        if path.exists():
            raise ParameterError(f"{name} exists already.", advice="Choose another name: nothing is overwritten.")
        return path

    def _inside(self, name: str) -> Path:
        if not self.roots:
            raise ForbiddenError(
                "This server reads and writes no files of its own machine.",
                advice="Send the file with upload_asset, or name a file of a job as JOB_ID/result.glb.",
            )
        # Resolved first, so that neither `..` nor a link leads out.
        path = (self.roots[0] / name).resolve()
        if not any(path.is_relative_to(root) for root in self.roots):
            raise ForbiddenError(f"{name} is outside the folders that this server may use.", advice=self._advice())
        return path

    def _advice(self) -> str:
        return f"Paths must be below {', '.join(map(str, self.roots))}."


class Tools:
    """The tools of one server. Every method with a docstring for agents is a tool.

    `connect` takes the context of a call, and returns a context manager with a client that has the caller's key.
    """

    def __init__(
        self, connect: Callable[[Context], AbstractAsyncContextManager[AsyncClient]], folders: Folders
    ) -> None:
        self._client, self._folders = connect, folders
        self._inspections = asyncio.Semaphore(_INSPECTIONS)

    async def list_models(self, ctx: Context) -> dict[str, Any]:
        """List the models that can guide a deformation, with the nouns and attributes that each understands.

        `shapes` has what prompts of deform can name by default, where no model is asked: words of the user's own first.
        """
        async with self._client(ctx) as client:
            return (await client.models()).model_dump(mode="json")

    async def inspect_asset(self, asset: Asset, ctx: Context) -> dict[str, Any]:
        """Show what an asset is and consists of: noun, front, parts, nodes, materials, components, joints, coordinates.

        `reading` has the noun and the front with their probability; deform's params guidance.source_noun and
        guidance.orientation (degrees) correct them, control.parts the parts. A prompt can change any of the `parts`:
        "longer legs". Names and numbers can be used in the parameters regions, rigid, exclude and parts of deform.
        """
        async with self._client(ctx) as client, self._local(client, asset) as path, self._inspections:
            return await _inspected(path)

    async def validate(
        self, asset: Asset, prompt: str, ctx: Context, params: Params = None, target: Asset | None = None
    ) -> dict[str, Any]:
        """Check a job without starting it: warnings about the asset, all its parameters, and how long it would take."""
        async with self._client(ctx) as client:
            wanted = self._folders.source(target) if target else None
            checked = await client.validate(self._folders.source(asset), prompt, params=params, target=wanted)
            return checked.model_dump(mode="json")

    async def try_prompt(
        self,
        asset: Asset,
        prompt: Annotated[str, Field(description='What the asset is to become: "a tall vase", "longer legs".')],
        path: Annotated[str, Field(description="The new GLB to write, for example vase-try.glb.")],
        ctx: Context,
        params: Params = None,
    ) -> dict[str, Any]:
        """Write what deform would make, in seconds and without a job, picture or verdict: to look before you start it.

        Other seeds in params give other designs. deform with the same prompt and params makes the same file.
        """
        where = self._folders.destination(path)
        async with self._client(ctx) as client:
            made = await client.preview_glb(self._folders.source(asset), prompt, params=params)
        where.write_bytes(made)
        return {"path": str(where), "bytes": len(made)}

    async def deform(
        self,
        asset: Asset,
        prompt: Annotated[str, Field(description='New shape of the asset, for example "a tall vase".')],
        ctx: Context,
        params: Params = None,
        output: Annotated[
            dict[str, Any] | None, Field(description='For example {"morph": true} for a file that animates the change.')
        ] = None,
    ) -> dict[str, Any]:
        """Start a job that fits an asset to what a prompt stands for, and return its id at once. Then call wait.

        It takes seconds. Topology, UVs, materials and rig stay as they are.
        """
        async with self._client(ctx) as client:
            return _summary(await client.submit(self._folders.source(asset), prompt, params=params, output=output))

    async def fit_to_mesh(
        self,
        asset: Asset,
        target: Annotated[str, Field(description="The mesh whose shape the asset takes; named like the asset.")],
        ctx: Context,
        params: Params = None,
    ) -> dict[str, Any]:
        """Start a job that gives an asset the shape of another mesh, and return its id at once. Then call wait."""
        async with self._client(ctx) as client:
            job = await client.submit(self._folders.source(asset), params=params, target=self._folders.source(target))
            return _summary(job)

    async def wait(
        self,
        job_id: JobId,
        ctx: Context,
        timeout_s: Annotated[float, Field(gt=0, le=_LONGEST_WAIT_S, description="Longest wait in seconds.")] = 60.0,
    ) -> dict[str, Any]:
        """Wait until a job has finished, and return its state and artifacts. Call it again if the job still runs.

        The verdict of a deformation comes first: good, doubtful, or keep_source, where the asset was better as it was.
        Tell its reasons, and follow its advice before you deliver what is not good.
        """

        async def told(event: EventView) -> None:
            if event.type == "progress":
                step, steps = event.data.get("step"), event.data.get("total_steps")
                await ctx.report_progress(event.data.get("fraction", 0.0), 1.0, f"step {step} of {steps}")

        async with self._client(ctx) as client:
            try:
                job = await client.wait(job_id, timeout_s=timeout_s, on_event=told, check=False)
            except WaitTimeoutError:
                return _summary(await client.get(job_id))
            return {**await _verdict(client, job), **_summary(job)}

    async def list_jobs(
        self,
        ctx: Context,
        search: Annotated[str, Field(description="Words of the prompt, the file names or the labels.")] = "",
        limit: Annotated[int, Field(ge=1, le=100)] = 20,
    ) -> dict[str, Any]:
        """List the newest jobs, all or those that contain every word of a search."""
        async with self._client(ctx) as client:
            jobs = []
            async for job in client.jobs(search=search, limit=limit):
                jobs.append(_summary(job))
                if len(jobs) == limit:
                    break
            return {"jobs": jobs}

    async def cancel(self, job_id: JobId, ctx: Context) -> dict[str, Any]:
        """Cancel a job that has not finished."""
        async with self._client(ctx) as client:
            return _summary(await client.cancel(job_id))

    async def preview(self, job_id: JobId, ctx: Context) -> Image:
        """Show a picture of the source and the result of a job that has succeeded."""
        async with self._client(ctx) as client:
            return Image(data=await client.read(job_id, "preview.png"), format="png")

    async def apply_strength(
        self,
        job_id: JobId,
        strength: Annotated[float, Field(ge=0.0, le=1.5, description="0: the source; 1: the result; up to 1.5.")],
        path: Annotated[str, Field(description="The new file to write, for example vase-60.glb.")],
        ctx: Context,
    ) -> dict[str, Any]:
        """Write the result of a job at another strength, without a new run."""
        where = self._folders.destination(path)
        async with self._client(ctx) as client:
            written = await client.download(job_id, "result.glb", where, strength=strength)
            return {"path": str(written), "bytes": written.stat().st_size}

    async def download(
        self,
        job_id: JobId,
        ctx: Context,
        name: Name = "result.glb",
        path: Annotated[str, Field(description="The new file to write. Default: NAME in the first folder.")] = "",
    ) -> dict[str, Any]:
        """Write an artifact of a job to a file."""
        where = self._folders.destination(path or name)
        async with self._client(ctx) as client:
            written = await client.download(job_id, name, where)
            return {"path": str(written), "bytes": written.stat().st_size}

    async def link(self, job_id: JobId, ctx: Context, name: Name = "result.glb") -> dict[str, Any]:
        """Return an absolute URL of an artifact that needs no API key and expires."""
        async with self._client(ctx) as client:
            return (await client.signed_url(job_id, name)).model_dump(mode="json")

    async def upload_asset(
        self,
        filename: Annotated[str, Field(description="Its name, with the extension that tells its format.")],
        data: Annotated[str, Field(description="The file, as base64.")],
        ctx: Context,
    ) -> dict[str, Any]:
        """Send a file to the service, and return the id by which the other tools take it."""
        try:
            decoded = base64.b64decode(data, validate=True)
        except binascii.Error as error:
            raise ToolError(f"data is not base64: {error}.") from error
        if len(decoded) > _UPLOAD_BYTES:
            raise ToolError(f"The file has more than {readable_size(_UPLOAD_BYTES)}, which is the limit here.")
        async with self._client(ctx) as client:
            upload = await client.upload(decoded, filename=filename)
            return {"asset": upload.id, "bytes": len(decoded)}

    @asynccontextmanager
    async def _local(self, client: AsyncClient, asset: str) -> AsyncIterator[Path]:
        """Provide an asset as a local file, downloaded if it belongs to a job."""
        source = self._folders.source(asset)
        if isinstance(source, Path):
            yield source
            return
        if "job_id" not in source:
            raise ParameterError(
                "An upload cannot be inspected.", advice="Start a job with it, then inspect JOB_ID/asset."
            )
        with tempfile.TemporaryDirectory() as folder:
            job, name = source["job_id"], source["artifact"]
            if name == "asset":
                view = await client.get(job)
                yield await client.download_asset(job, Path(folder) / Path(view.asset.filename).name)
            else:
                yield await client.download(job, name, Path(folder) / name)


def explained(tool: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
    """Return the tool with errors that an agent can act on: what happened and what to do."""

    @functools.wraps(tool)
    async def run(*args: Any, **kwargs: Any) -> Any:
        try:
            return await tool(*args, **kwargs)
        except MeshdeformError as error:
            raise ToolError(f"{error.detail} {error.advice_text} ({error.code})".strip()) from error
        except ValidationError as error:
            raise ToolError(first_problem(error)) from error
        except ValueError as error:
            raise ToolError(str(error)) from error

    return run


async def _verdict(client: AsyncClient, job: JobView) -> dict[str, Any]:
    """Return the `verdict` of a job's report: its value, reasons and advice; nothing where there is none."""
    if all(artifact.name != _REPORT for artifact in job.artifacts):
        return {}
    found = read_verdict(json.loads(await client.read(job, _REPORT)))
    return {} if found is None else {"verdict": {name: found[name] for name in ("value", "reasons", "advice")}}


def _summary(job: JobView) -> dict[str, Any]:
    """Return the members of a job that an agent needs."""
    summary: dict[str, Any] = {
        "job_id": job.id,
        "state": job.state.value,
        "prompt": job.prompt,
        "progress": job.progress.model_dump(mode="json", exclude_none=True),
        "artifacts": [artifact.name for artifact in job.artifacts],
    }
    if job.error is not None:
        summary["error"] = job.error.model_dump(mode="json", exclude_none=True)
    return summary


async def _inspected(path: Path) -> dict[str, Any]:
    # A process of its own: a hostile file takes nothing else down, and this server needs no numerical library.
    command = [sys.executable, "-m", "meshdeform", "inspect", str(path), "--json"]
    process = await asyncio.create_subprocess_exec(
        *command,
        env={name: value for name, value in os.environ.items() if name != "MESHDEFORM_API_KEY"},
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        output, errors = await asyncio.wait_for(process.communicate(), _INSPECTION_S)
    except TimeoutError:
        raise ToolError(f"Inspecting the file took longer than {_INSPECTION_S:g} s.") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    if process.returncode:
        problem = _problem(errors.decode(errors="replace"))
        raise ToolError(problem)
    document: dict[str, Any] = json.loads(output)
    return document


def _problem(text: str) -> str:
    """Return the sentence of a command's error, which is the last line and a JSON document."""
    try:
        document = json.loads(text.strip().splitlines()[-1])
        return f"{document['detail']} {document.get('advice', '')} ({document.get('code', '')})"
    except (IndexError, ValueError, KeyError, TypeError):
        return "The file could not be inspected."
