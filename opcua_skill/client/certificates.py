"""This client's certificate, and the servers it knows: a stranger at a known address gets no password."""

import hashlib
import os
import re
from pathlib import Path
from urllib.parse import urlparse

from opcua_skill.client.errors import ServerChanged

APPLICATION_URI = "urn:opcua-skill:client"


def client_folder() -> Path:
    """Return where this user's client certificate and known servers are kept (``OPCUA_SKILL_CLIENT_DIR`` overrides)."""
    if given := os.environ.get("OPCUA_SKILL_CLIENT_DIR"):
        return Path(given)
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "opcua-skill" / "client"


class KnownServers:
    """The certificate each address showed at the first meeting, one DER file a server."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def file(self, url: str) -> Path:
        """Return the file that holds the certificate of the server at ``url``."""
        return self._folder / (re.sub(r"[^A-Za-z0-9.-]", "_", urlparse(url).netloc) + ".der")

    def meet(self, url: str, certificate: bytes) -> None:
        """Remember a server's certificate, or refuse one that differs from the remembered one."""
        file = self.file(url)
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            file.write_bytes(certificate)
        elif file.read_bytes() != certificate:
            raise ServerChanged(
                f"the server at {url} shows another certificate than before (SHA-256 {fingerprint(certificate)[:16]}…)"
                f": if it was renewed on purpose, delete {file}"
            )


def fingerprint(certificate: bytes) -> str:
    """Return the SHA-256 of a DER certificate in hex, as a person compares it."""
    return hashlib.sha256(certificate).hexdigest()
