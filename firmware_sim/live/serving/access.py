"""Who may look at the loop and act on it: the page of this server, and on another machine whoever has the link.

A browser sends requests to a server on this machine for any page that asks it to. Against such pages stands the
request's Origin, which must be this server's; and against a name that its owner lets point to this machine (DNS
rebinding) the request's Host.
"""

from dataclasses import dataclass
from hmac import compare_digest
from ipaddress import ip_address
from secrets import token_urlsafe
from typing import Final, Self
from urllib.parse import urlsplit

TOKEN_BYTES: Final = 24


@dataclass(frozen=True, kw_only=True)
class Access:
    """To one server. Every request must show the token; there is none for a server that only this machine can reach."""

    token: str | None

    @classmethod
    def to(cls, address: str) -> Self:
        """For a server at this address: with a token of its own unless it is this machine's loopback."""
        return cls(token=None if is_loopback(address) else token_urlsafe(TOKEN_BYTES))

    def refusal(self, *, host: str, origin: str | None, token: str | None) -> str | None:
        """Why a request is refused, for people; None if it is not. `origin` is None where there is none, as from a
        program that is no browser."""
        if self.token is None and not is_loopback(_name(host)):
            return "this server answers to localhost alone"
        if origin is not None and origin.lower().partition("://")[2] != host.lower():
            return "a page of another server may not use this one"
        if self.token is None or compare_digest((token or "").encode(), self.token.encode()):
            return None
        return "open the link that `stillwake live` printed: it has the token"


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach it."""
    try:
        return ip_address(address).is_loopback
    except ValueError:
        return address.lower() == "localhost"


def _name(host: str) -> str:
    """Name in a Host header, without its port; empty if it is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
