"""A host and a port, as the value of a flag."""

from __future__ import annotations

import click

_PORTS = 65_535


class Address(click.ParamType[tuple[str, int]]):
    """A host and a port; its value is both."""

    name = "host:port"

    def convert(
        self, value: str | tuple[str, int], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, int]:
        """Both of them."""
        if not isinstance(value, str):
            return value
        host, _, port = value.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) <= _PORTS:
            self.fail(f"{value!r} is not an address such as localhost:25", param, ctx)
        return host.removeprefix("[").removesuffix("]"), int(port)
