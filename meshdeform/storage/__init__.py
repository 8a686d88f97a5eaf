"""Store bytes by key, in a folder or in an S3-compatible bucket, behind one small class.

An object is either complete or absent. In a folder, a temporary file is written, synced to the disk and renamed
(obstore's own folder store does not sync); a bucket stores objects atomically. Torch-free and numpy-free.
"""

from __future__ import annotations

from meshdeform.storage.base import StoredObject
from meshdeform.storage.signatures import sign_path, verify_path
from meshdeform.storage.store import ObjectStore

__all__ = ["ObjectStore", "StoredObject", "sign_path", "verify_path"]
