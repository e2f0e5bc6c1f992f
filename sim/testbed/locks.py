"""Locks by name between the processes of this machine: for ROS domains and TCP ports.

A lock is an abstract Unix socket: the kernel lets one process bind a name, frees it when that
process ends (however it ends), and counts names per network namespace, just as it counts ports.
So there are no lock files to leave behind, to share between users, or to miss in a container.
"""

from __future__ import annotations

import errno
import socket


def claim(name: str) -> socket.socket | None:
    """Lock ``name`` until the returned socket is closed; None while it is locked."""
    holder = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        holder.bind(f"\0fleet-demo/{name}")
    except OSError as error:
        holder.close()
        if error.errno != errno.EADDRINUSE:
            raise
        return None
    return holder
