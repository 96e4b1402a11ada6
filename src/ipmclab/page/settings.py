"""Where the page listens, and whom it lets in."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from ipmclab.errors import InputError

LOOPBACK: Final = "127.0.0.1"

LEAST_TOKEN: Final = 16
"""Letters of a token that cannot be guessed."""

MOST_BYTES: Final = 256 * 1024 * 1024
"""Of one request: a record that is uploaded is not larger."""


@dataclass(frozen=True)
class Settings:
    """Where the page listens, and whom it lets in.

    Parameters
    ----------
    host : str
        The address it binds.
    port : int
        0: the folder's own, or any that is free.
    origin : str, optional
        Under which browsers reach it from elsewhere: ``https://lab.example.org:8443``.
    token : str, optional
        What a browser must know once.
    certificate, key : Path, optional
        For HTTPS.
    recorder : str
        The program of the recorder's process: ``python -m`` runs it.
    """

    host: str = LOOPBACK
    port: int = 0
    origin: str | None = None
    token: str | None = None
    certificate: Path | None = None
    key: Path | None = None
    recorder: str = ""

    @property
    def is_local(self) -> bool:
        """Whether only this computer reaches it."""
        return is_loopback(self.host)


def bracketed(host: str) -> str:
    """A host as an address line has it.

    Examples
    --------
    >>> bracketed("::1")
    '[::1]'
    """
    return f"[{host}]" if ":" in host else host


def is_loopback(host: str) -> bool:
    """Whether an address is this computer's own, whom nobody else reaches."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _is_origin(text: str) -> bool:
    try:
        parts = urlsplit(text)
        return (
            parts.scheme == "https"
            and bool(parts.hostname)
            and (parts.port or 443) > 0
            and parts.path in ("", "/")
            and not (parts.query or parts.fragment or "@" in parts.netloc)
        )
    except ValueError:  # brackets without an address, or a port that is none
        return False


def checked(settings: Settings, *, proxy: bool) -> Settings:
    """The settings, if nobody who should not could get in.

    Parameters
    ----------
    settings : Settings
    proxy : bool
        Whether a proxy in front of it speaks HTTPS.

    Raises
    ------
    InputError
        An address that others reach, without a token, without HTTPS, or without the name that browsers use.
    """
    if settings.token is not None and len(settings.token) < LEAST_TOKEN:
        raise InputError(
            f"the token has {len(settings.token)} letters, it must have {LEAST_TOKEN} or more",
            code="bad-token",
            where="--token-file",
            repair='write one with: python -c "import secrets; print(secrets.token_urlsafe())"',
        )
    if (settings.certificate is None) != (settings.key is None):
        raise InputError(
            "a certificate and its key belong together",
            code="usage",
            where="--certificate",
            repair="give --certificate FILE --key FILE",
        )
    if settings.origin is not None and not _is_origin(settings.origin):
        raise InputError(
            f"{settings.origin!r} is no address of the form https://NAME or https://NAME:PORT",
            code="bad-origin",
            where="--origin",
            repair="give what browsers show in their address line",
        )
    if settings.is_local and settings.origin is None and not proxy:
        return settings
    missing = []
    if settings.token is None:
        missing.append("--token-file FILE")
    if settings.origin is None:
        missing.append("--origin https://NAME")
    if settings.certificate is None and not proxy:
        missing.append("--certificate FILE --key FILE (or --proxy, where a proxy in front of it uses HTTPS)")
    if missing:
        option = "--host" if settings.origin is None else "--origin"
        raise InputError(
            f"others reach {settings.origin or settings.host}: whoever finds it could drive the bench",
            code="unsafe-address",
            where=option,
            repair=f"add {', '.join(missing)}; or leave {option} away, and reach this computer through an SSH tunnel",
        )
    return settings
