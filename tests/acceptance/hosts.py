"""Hosts of their own on one machine: network namespaces with a bridge between them, which only root can make."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.servers import NotInstalledError

__all__ = ["Network", "network"]

_NEW_NET = 0x40000000  # CLONE_NEWNET
_PREFIX = "10.213.47"


@dataclass(frozen=True)
class Network:
    """Namespaces on a bridge. The first one holds the bridge, and the thread that made the network is in it.

    `tag` begins the names of the namespaces; `names` has the hosts in the order of their addresses.
    """

    tag: str
    names: tuple[str, ...]

    def address(self, name: str) -> str:
        """A host's address."""
        return f"{_PREFIX}.{self.names.index(name) + 1}"

    def inside(self, name: str) -> list[str]:
        """What to put before a command that shall run on a host."""
        return ["ip", "netns", "exec", f"{self.tag}-{name}"]

    def cut_off(self, name: str) -> None:
        """Pull a host's cable."""
        _ip("link", "set", f"{self.tag}{self.names.index(name)}", "down")

    def connect(self, name: str) -> None:
        """Plug it in again."""
        _ip("link", "set", f"{self.tag}{self.names.index(name)}", "up")


@contextlib.contextmanager
def network(names: Sequence[str]) -> Iterator[Network]:
    """Make hosts and enter the first one, for the block; takes root, the right to make namespaces, and the program ip.

    Use it only in a process of its own: threads that libraries start in the block stay in the namespace.
    """
    if os.geteuid() != 0 or shutil.which("ip") is None:
        raise NotInstalledError("hosts of their own need root and the program ip (apt install iproute2)")
    made = Network(f"md{os.getpid() % 10000}n", tuple(names))
    home = os.open("/proc/self/ns/net", os.O_RDONLY)
    spaces = [f"{made.tag}-{name}" for name in names]
    try:
        try:
            for space in spaces:
                _ip("netns", "add", space)
                _ip("-n", space, "link", "set", "lo", "up")
        except subprocess.CalledProcessError as error:
            raise NotInstalledError("network namespaces cannot be made here") from error
        _enter(Path("/run/netns") / spaces[0])
        _ip("link", "add", "bridge", "type", "bridge")
        _ip("address", "add", f"{made.address(names[0])}/24", "dev", "bridge")
        _ip("link", "set", "bridge", "up")
        for number, name in enumerate(names[1:], 1):
            cable, space = f"{made.tag}{number}", spaces[number]
            _ip("link", "add", cable, "type", "veth", "peer", "name", "eth0", "netns", space)
            _ip("link", "set", cable, "master", "bridge", "up")
            _ip("-n", space, "address", "add", f"{made.address(name)}/24", "dev", "eth0")
            _ip("-n", space, "link", "set", "eth0", "up")
        yield made
    finally:
        _enter(home)
        os.close(home)
        for space in spaces:
            subprocess.run(["ip", "netns", "delete", space], check=False, capture_output=True)


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)


def _enter(space: Path | int) -> None:
    """Move this thread, and what it starts from now on, into a namespace."""
    descriptor = os.open(space, os.O_RDONLY) if isinstance(space, Path) else os.dup(space)
    try:
        if ctypes.CDLL(None, use_errno=True).setns(descriptor, _NEW_NET) != 0:
            raise OSError(ctypes.get_errno(), "setns")
    finally:
        os.close(descriptor)
