"""Worker threads for calls into the exporter: few threads, few pending calls, shared results.

A flood of requests must only cost a limited number of threads and calls. Requests above that are
answered 503.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")


class BusyError(Exception):
    """Too many calls are pending; the HTTP status is 503."""


class Workers:
    """Runs functions in its own threads, for one kind of request.

    Args:
        name: Of the threads.
        threads: How many functions run at once.
        max_pending: How many requests may wait, including those that share a call.
    """

    def __init__(self, name: str, threads: int, max_pending: int) -> None:
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._max_pending = max_pending
        self._pending = 0
        self._shared: dict[Hashable, asyncio.Future[Any]] = {}

    async def run(self, function: Callable[..., T], *arguments: Any) -> T:
        """What ``function`` returns or raises; BusyError when too many requests wait."""
        return await self._wait(self._submit(function, *arguments))

    async def run_shared(self, seconds: float, function: Callable[..., T], *arguments: Any) -> T:
        """As ``run``, but the result is shared until it is ``seconds`` old.

        An exception is shared only with the requests that were already waiting. ``arguments`` are
        part of the cache's key, so clients must not be able to choose them.
        """
        key = (function, arguments)
        if key not in self._shared:
            call = self._submit(function, *arguments)
            self._shared[key] = call
            call.add_done_callback(lambda done: self._expire_later(key, done, seconds))
        return await self._wait(asyncio.shield(self._shared[key]))

    def invalidate(self) -> None:
        """Drop the shared results, because something has changed."""
        self._shared.clear()

    def _expire_later(self, key: Hashable, call: asyncio.Future[Any], seconds: float) -> None:
        if call.cancelled() or call.exception() is not None or seconds == 0:
            self._expire(key, call)
        else:
            call.get_loop().call_later(seconds, self._expire, key, call)

    def _expire(self, key: Hashable, call: asyncio.Future[Any]) -> None:
        if self._shared.get(key) is call:
            del self._shared[key]

    def close(self) -> None:
        """Wait for the running calls; none may follow."""
        self._executor.shutdown(cancel_futures=True)

    def _submit(self, function: Callable[..., T], *arguments: Any) -> asyncio.Future[T]:
        if self._pending >= self._max_pending:
            raise BusyError
        return asyncio.get_running_loop().run_in_executor(self._executor, function, *arguments)

    async def _wait(self, call: asyncio.Future[T]) -> T:
        if self._pending >= self._max_pending:
            raise BusyError
        self._pending += 1
        try:
            return await call
        finally:
            self._pending -= 1
