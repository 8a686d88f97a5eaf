"""Define the errors that the panel shows. Does not use bpy."""

from __future__ import annotations


class AddonError(Exception):
    """An error with a message for the user.

    Parameters
    ----------
    detail : str
        What happened.
    advice : str
        What to do about it.
    code : str
        The service's error code, if there is one.
    """

    def __init__(self, detail: str, advice: str = "", code: str = "") -> None:
        super().__init__(detail)
        self.detail, self.advice, self.code = detail, advice, code

    @property
    def text(self) -> str:
        """Detail and advice in one line."""
        return f"{self.detail} {self.advice}".strip()


class Canceled(Exception):  # noqa: N818 - not an error
    """The user canceled the job."""
