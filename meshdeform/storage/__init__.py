"""The object store: bytes by key, in a folder or in an S3-compatible bucket, behind one small class.

A key is absent or whole, never half: in a folder a file is written aside, synced to the disk and renamed (obstore's own
folder store does not sync), a bucket puts objects atomically. Torch-free and numpy-free.
"""

from __future__ import annotations

from meshdeform.storage.base import StoredObject
from meshdeform.storage.signing import sign_path, verify_path
from meshdeform.storage.store import ObjectStore

__all__ = ["ObjectStore", "StoredObject", "sign_path", "verify_path"]
