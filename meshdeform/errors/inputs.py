"""Define the errors of what a request contains: the files, the request document and the model that it names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from meshdeform.errors.base import MeshdeformError

__all__ = [
    "AlignmentError",
    "AssetEmptyError",
    "AssetError",
    "AssetExternalError",
    "AssetFormatError",
    "AssetNotFiniteError",
    "AssetTooLargeError",
    "AssetTruncatedError",
    "AssetUnsupportedError",
    "ChecksumError",
    "DrawingError",
    "IdempotencyMismatchError",
    "ModelError",
    "ParameterError",
    "PromptError",
    "RequestError",
    "SilhouetteError",
    "VocabularyError",
    "WebhookAddressError",
]


class AssetError(MeshdeformError):
    """The asset is not valid."""

    status = 422
    code = "asset_invalid"
    advice = "Check the file with the Khronos glTF validator, or export it again."


class AssetFormatError(AssetError):
    """Meshdeform cannot read the file's format."""

    status = 415
    code = "asset_format"
    advice = "Send glTF 2.0 (.glb, or .gltf with its files as a ZIP), or a mesh as OBJ, PLY or STL."


class AssetTruncatedError(AssetError):
    """The file is truncated."""

    code = "asset_truncated"
    advice = "Send the whole file, or export it again if it is damaged on disk."


class AssetTooLargeError(AssetError):
    """The asset exceeds a limit of this server."""

    status = 413
    code = "asset_too_large"
    advice = "Simplify the mesh, or raise the limit that the message names."


class AssetExternalError(AssetError):
    """The asset refers to a file that was not sent."""

    code = "asset_external_uri"
    advice = "Send the .gltf and its files as a ZIP, or pack them into a .glb: gltf-transform copy in.gltf out.glb"


class AssetUnsupportedError(AssetError):
    """The asset needs something that Meshdeform cannot decode."""

    code = "asset_unsupported"
    advice = "Export it without the extension that the message names."


class AssetNotFiniteError(AssetError):
    """The asset has positions that are not finite numbers."""

    code = "asset_not_finite"
    advice = "Remove the NaN or infinite vertices and export again."


class AssetEmptyError(AssetError):
    """The asset has no triangles to deform."""

    code = "asset_no_triangles"
    advice = "Points and lines cannot be deformed; send a mesh with triangles."


class DrawingError(AssetError):
    """A picture is not a line drawing."""

    code = "not_a_drawing"
    advice = "Draw the outlines of one thing with dark lines on an even, bright page."


class SilhouetteError(AssetError):
    """The picture shows no silhouette that can be used."""

    code = "silhouette_unusable"
    advice = "Send a mask, or a picture of one object in front of a plain background."


class RequestError(MeshdeformError):
    """The request is not valid."""

    status = 422
    code = "request_invalid"
    advice = "Compare the request with /openapi.json."

    def located(self, loc: Sequence[str | int], message: str | None = None) -> Self:
        """Return the error after naming the member of the request that it is about."""
        self.extra["errors"] = [{"loc": [*loc], "msg": message or self.detail, "type": "value_error"}]
        return self


class ParameterError(RequestError):
    """A parameter is unknown or out of range."""

    code = "parameter_invalid"
    advice = "Fix the members that `errors` names."

    @classmethod
    def at(
        cls, loc: Sequence[str | int], detail: str, advice: str | None = None, *, message: str | None = None
    ) -> Self:
        """Return the error about one member of a request.

        Parameters
        ----------
        loc : sequence of str and int
            The path to the member, as in `["params", "handles", 2]`.
        detail : str
            One sentence about this occurrence.
        advice : str, optional
            What to do about it. Default: the class's advice.
        message : str, optional
            What stands beside the member. Default: `detail`.
        """
        return cls(detail, advice=advice).located(loc, message)


class AlignmentError(RequestError):
    """The target mesh could not be placed on the asset."""

    code = "alignment_failed"
    advice = "Turn and move the target onto the asset, and set params.align to none."

    picture: bytes | None = None
    """A PNG of both meshes, as they were placed."""


class PromptError(RequestError):
    """The prompt is empty or too long."""

    code = "prompt_invalid"
    advice = "Describe in a few words what the asset should become, for example: a mushroom."


class VocabularyError(RequestError):
    """The builtin demonstration prior does not know a word of the prompt."""

    code = "prompt_unknown_words"
    advice = (
        "Use one of the suggested prompts, or choose a Stable Diffusion model: "
        'set params.model to its id or folder (install the "sd" extra on the worker).'
    )


class IdempotencyMismatchError(RequestError):
    """The Idempotency-Key was used for another request."""

    code = "idempotency_mismatch"
    advice = "Send the same request as the first time, or a new key for a new request."


class ChecksumError(RequestError):
    """The bytes differ from what the sender announced."""

    code = "checksum_mismatch"
    advice = "Send the file again; compare its size and its SHA-256 with what you announced."


class WebhookAddressError(RequestError):
    """The webhook's address is not allowed."""

    code = "webhook_address"
    advice = (
        "Use an https URL whose host has only public addresses. The server's operator can allow other networks, "
        "for example MESHDEFORM_WEBHOOK_NETWORKS=10.1.0.0/16,fd00::/8."
    )


class ModelError(MeshdeformError):
    """The diffusion model cannot be loaded."""

    status = 422
    code = "model_unavailable"
    advice = (
        "Download it once on a machine with internet access (hf download ID --local-dir FOLDER) "
        "and set MESHDEFORM_MODEL to the folder, or use the builtin demonstration prior (model: builtin)."
    )
