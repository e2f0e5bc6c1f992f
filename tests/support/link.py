"""A network link between two programs, which can be cut."""

import asyncio
import threading
from collections.abc import Coroutine
from contextlib import suppress
from typing import Any

from testbed.ports import free_port


class Link:
    """Forwards TCP connections from ``address`` to another address, unless it is cut.

    Cut, it closes all connections and accepts none.
    """

    def __init__(self, to: str) -> None:
        self.address = f"127.0.0.1:{free_port()}"
        self._to = to
        self._writers: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self.heal()

    def heal(self) -> None:
        """Accept connections again."""
        self._call(self._listen())

    def cut(self) -> None:
        """Close every connection, and accept none."""
        self._call(self._cut())

    def close(self) -> None:
        """Cut it, for good."""
        self._call(self._cut())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _call(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(10)

    async def _listen(self) -> None:
        host, _, port = self.address.partition(":")
        self._server = await asyncio.start_server(self._forward, host, int(port))

    async def _cut(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None
        for writer in self._writers:
            writer.close()

    async def _forward(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        host, _, port = self._to.partition(":")
        with suppress(OSError):  # the other end refuses, or the link is cut
            onward, out = await asyncio.open_connection(host, int(port))
            await asyncio.gather(self._copy(reader, out), self._copy(onward, writer))
        writer.close()

    async def _copy(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._writers.add(writer)
        try:
            while block := await reader.read(65536):
                writer.write(block)
                await writer.drain()
        finally:
            self._writers.discard(writer)
            writer.close()
