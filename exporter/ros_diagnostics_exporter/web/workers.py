"""Calls into the exporter, beside the event loop: few threads, few waiting, one for all who ask.

A flood of requests must cost a bounded number of threads and of calls; whoever comes when too many
wait is told to come again.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")


class BusyError(Exception):
    """Too many calls are waiting; the HTTP answer is 503."""


class Calls:
    """Runs functions in threads of its own, for one kind of request.

    Args:
        name: Of the threads.
        threads: How many functions run at once.
        waiting: How many requests may wait, those included that share a call.
    """

    def __init__(self, name: str, threads: int, waiting: int) -> None:
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._waiting = waiting
        self._asked = 0
        self._shared: dict[Hashable, asyncio.Future[Any]] = {}

    async def run(self, function: Callable[..., T], *arguments: Any) -> T:
        """What ``function`` returns or raises; BusyError when too many wait."""
        return await self._wait(self._begin(function, *arguments))

    async def share(self, seconds: float, function: Callable[..., T], *arguments: Any) -> T:
        """As ``run``, but one call serves all who ask until it is done and ``seconds`` old.

        What it raises is shared only with those who waited for it. ``arguments`` are part of what
        is remembered, so they must not be a client's to choose.
        """
        key = (function, arguments)
        if key not in self._shared:
            call = self._begin(function, *arguments)
            self._shared[key] = call
            call.add_done_callback(lambda done: self._forget_later(key, done, seconds))
        return await self._wait(asyncio.shield(self._shared[key]))

    def renew(self) -> None:
        """Let who asks from now on not share in what was begun before: something has changed."""
        self._shared.clear()

    def _forget_later(self, key: Hashable, call: asyncio.Future[Any], seconds: float) -> None:
        if call.cancelled() or call.exception() is not None or seconds == 0:
            self._forget(key, call)
        else:
            call.get_loop().call_later(seconds, self._forget, key, call)

    def _forget(self, key: Hashable, call: asyncio.Future[Any]) -> None:
        if self._shared.get(key) is call:
            del self._shared[key]

    def close(self) -> None:
        """Wait for the calls under way; none may follow."""
        self._executor.shutdown(cancel_futures=True)

    def _begin(self, function: Callable[..., T], *arguments: Any) -> asyncio.Future[T]:
        if self._asked >= self._waiting:
            raise BusyError
        return asyncio.get_running_loop().run_in_executor(self._executor, function, *arguments)

    async def _wait(self, call: asyncio.Future[T]) -> T:
        if self._asked >= self._waiting:
            raise BusyError
        self._asked += 1
        try:
            return await call
        finally:
            self._asked -= 1
