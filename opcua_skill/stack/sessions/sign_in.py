"""From an identity token to a proven user: decrypt, check the nonce and the signature, then ask the authenticator."""

import hmac
import logging
import struct
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.crypto import uacrypto
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes
from cryptography import x509
from cryptography.exceptions import InvalidSignature

from opcua_skill.security.access import Identity, Role, SignIn
from opcua_skill.stack.address_space.values import node_id
from opcua_skill.stack.sessions.sessions import Channel

log = logging.getLogger(__name__)

# RSA 1.5 padding is left out on purpose: it can be attacked through the server's answers.
_DECRYPT = {
    "http://www.w3.org/2001/04/xmlenc#rsa-oaep": uacrypto.decrypt_rsa_oaep,
    "http://opcfoundation.org/UA/security/rsa-oaep-sha2-256": uacrypto.decrypt_rsa_oaep_sha256,
}
_VERIFY = {
    "http://www.w3.org/2001/04/xmldsig-more#rsa-sha256": uacrypto.verify_sha256,
    "http://opcfoundation.org/UA/security/rsa-pss-sha2-256": uacrypto.verify_pss_sha256,
}
MAX_PASSWORD_TOKEN = 8192


async def prove_identity(
    sign_in: SignIn,
    channel: Channel,
    params: ua.ActivateSessionParameters,
    *,
    nonce: bytes,
    certificate: Any,
    private_key: Any,
    anonymous: bool,
) -> Identity:
    """Return the user an ActivateSession request proves to come from, or raise ServiceError with the code to answer."""
    token = params.UserIdentityToken
    if isinstance(token, ua.UserNameIdentityToken):
        name, password = token.UserName or "", read_password(token, channel, nonce, private_key)
        identity = await sign_in.by_password(name, password, channel.peer)
    elif isinstance(token, ua.X509IdentityToken):
        user_certificate = verify_user_certificate(token, params.UserTokenSignature, nonce, certificate)
        identity = await sign_in.by_certificate(user_certificate, channel.peer)
    elif anonymous and (isinstance(token, ua.AnonymousIdentityToken) or _is_null(token)):
        return Identity("", Role.OBSERVER)
    else:
        raise ServiceError(Codes.BadIdentityTokenRejected)
    if identity is None:
        raise ServiceError(Codes.BadUserAccessDenied)
    return identity


def read_password(token: ua.UserNameIdentityToken, channel: Channel, nonce: bytes, private_key: Any) -> str:
    """Return the password in a token (OPC 10000-4, 7.40.4); one in clear text only inside an encrypted channel.

    What follows the nonce is padding (7.40.2.2): a client may add some, and all of it has to be zero.
    """
    sealed = token.Password or b""
    if len(sealed) > MAX_PASSWORD_TOKEN:
        raise ServiceError(Codes.BadIdentityTokenInvalid)
    try:
        if token.EncryptionAlgorithm:
            decrypt = _DECRYPT.get(token.EncryptionAlgorithm)
            if decrypt is None or private_key is None:
                raise ServiceError(Codes.BadIdentityTokenInvalid)
            block = private_key.key_size // 8
            plain = b"".join(decrypt(private_key, sealed[at : at + block]) for at in range(0, len(sealed), block))
            (length,) = struct.unpack_from("<I", plain)
            secret, padding, end = plain[4 : 4 + length], plain[4 + length :], length - len(nonce)
            whole = len(secret) == length and end >= 0 and not any(padding)
            if not whole or not hmac.compare_digest(secret[end:], nonce):
                raise ServiceError(Codes.BadIdentityTokenInvalid)
            return secret[:end].decode("utf-8")
        if channel.mode != ua.MessageSecurityMode.SignAndEncrypt:
            raise ServiceError(Codes.BadIdentityTokenInvalid)
        return bytes(sealed).decode("utf-8")
    except (ValueError, struct.error):
        raise ServiceError(Codes.BadIdentityTokenInvalid) from None


def verify_user_certificate(
    token: ua.X509IdentityToken, signature: ua.SignatureData, nonce: bytes, certificate: Any
) -> bytes:
    """Return the user certificate (DER) of a token whose signature proves possession of its key."""
    verify = _VERIFY.get(signature.Algorithm or "")
    if verify is None or not signature.Signature or not token.CertificateData:
        raise ServiceError(Codes.BadIdentityTokenInvalid)
    server = uacrypto.der_from_x509(certificate) if certificate is not None else b""
    try:
        user = x509.load_der_x509_certificate(token.CertificateData)
        verify(user, server + nonce, signature.Signature)
    except InvalidSignature:
        raise ServiceError(Codes.BadUserSignatureInvalid) from None
    except (ValueError, TypeError):
        raise ServiceError(Codes.BadIdentityTokenInvalid) from None
    if not user.not_valid_before_utc <= datetime.now(UTC) <= user.not_valid_after_utc:
        log.warning("user certificate %s is not valid today", user.subject.rfc4514_string())
        raise ServiceError(Codes.BadIdentityTokenRejected)
    return uacrypto.der_from_x509(user)


def _is_null(token: Any) -> bool:
    return token is None or (isinstance(token, ua.ExtensionObject) and token.TypeId == node_id(Ids.Null))
