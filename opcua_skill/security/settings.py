"""What a server is told about its security. The defaults are the safe ones; every other one has to be said in words."""

from dataclasses import dataclass
from pathlib import Path

POLICIES = ("Basic256Sha256", "Aes128_Sha256_RsaOaep", "Aes256_Sha256_RsaPss")


@dataclass(frozen=True, slots=True)
class SecuritySettings:
    """Where the server listens, who it says it is, where its keys lie, and what it lets in.

    ``folder`` holds the server's key and certificate and the trust list. ``host_names`` are further names or addresses
    under which clients reach the server; they go into its certificate. ``policies`` are always used with
    SignAndEncrypt. The server registers itself with each of the ``discovery_servers``. The three ``insecure_`` switches
    are shown by ``SkillServer.insecure`` and in the log.
    """

    folder: Path
    endpoint: str = "opc.tcp://127.0.0.1:4840/opcua-skill"
    application_uri: str = "urn:opcua-skill:server"
    application_name: str = "opcua-skill"
    host_names: tuple[str, ...] = ()
    policies: tuple[str, ...] = POLICIES
    discovery_servers: tuple[str, ...] = ()
    insecure_no_encryption: bool = False
    insecure_anonymous: bool = False
    insecure_trust_every_client: bool = False

    def __post_init__(self) -> None:
        unknown = [name for name in self.policies if name not in POLICIES]
        if unknown:
            raise ValueError(f"security policy {unknown[0]} is not one of {', '.join(POLICIES)}")
        if not self.policies and not self.insecure_no_encryption:
            raise ValueError("no security policy is left: name at least one")

    @property
    def insecure(self) -> tuple[str, ...]:
        """Return in words what protects less than it should; empty when all is as it should be."""
        said = (
            (self.insecure_no_encryption, "connections without encryption are accepted"),
            (self.insecure_anonymous, "anonymous sessions are accepted, as observers"),
            (self.insecure_trust_every_client, "every client certificate is trusted"),
        )
        return tuple(words for on, words in said if on)
