"""Certificates made at first start, the trust list, users and their passwords, and what a server is told about them."""

from opcua_skill.security.certificates import (
    ApplicationCertificate,
    CertificateUnusable,
    ensure_client_certificate,
    ensure_server_certificate,
    load_certificate,
    thumbprint,
)
from opcua_skill.security.chains import CertificateFault
from opcua_skill.security.settings import POLICIES, SecuritySettings
from opcua_skill.security.trust import ListedCertificate, TrustList
from opcua_skill.security.users import Authenticator, LockOut, StoredUser, UserStore, hash_password

__all__ = [
    "POLICIES",
    "ApplicationCertificate",
    "Authenticator",
    "CertificateFault",
    "CertificateUnusable",
    "ListedCertificate",
    "LockOut",
    "SecuritySettings",
    "StoredUser",
    "TrustList",
    "UserStore",
    "ensure_client_certificate",
    "ensure_server_certificate",
    "hash_password",
    "load_certificate",
    "thumbprint",
]
