"""Chunks of an open channel (OPC 10000-6, 6.7.2): checked, decrypted and joined, encrypted and numbered.

What asyncua does with several objects and copies for each chunk is done here on the bytes themselves. The chunks that
open or renew a channel stay with asyncua.
"""

import hmac
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.common.connection import SecureConnection, TransportLimits
from asyncua.common.utils import Buffer
from asyncua.crypto.security_policies import SecurityPolicyNone, SignerHMac256, VerifierHMac256
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.ua_binary import header_from_binary
from asyncua.ua.uaerrors import UaStatusCodeError
from cryptography.exceptions import InvalidSignature

_HEADER = struct.Struct("<4sIII")
_CHANNEL = struct.Struct("<II")
_SEQUENCE = struct.Struct("<II")
_PREFIX = _HEADER.size
_FINAL, _MORE = b"MSGF", b"MSGC"
_ABORT = ord("A")
_WRAPS_AFTER, _WRAPS_TO = (1 << 32) - 1024, 1024


@dataclass(frozen=True, slots=True)
class Request:
    """One whole message: what its answer has to name, and its body."""

    RequestId: int
    body: Buffer


class SecureChannel(SecureConnection):
    """The secure channel of one connection."""

    def __init__(self, limits: TransportLimits) -> None:
        super().__init__(SecurityPolicyNone(), limits)
        self._parts: list[bytes] = []
        self._parts_of = 0
        self.unfinished_bytes = 0

    def receive_opening(self, frame: bytes) -> Any:
        """Return the message of an OPN chunk."""
        buffer = Buffer(frame)
        return self.receive_from_header_and_body(header_from_binary(buffer), buffer)

    def receive(self, frame: bytes, largest: int) -> Request | None:
        """Return the message that is whole with this chunk, None while there are parts to come or it was given up.

        ``largest`` is how many bytes a message may have. Raises InvalidSignature, or an error with the code that fits.
        """
        if len(frame) > self._limits.max_recv_buffer or self.unfinished_bytes + len(frame) > largest:
            raise UaStatusCodeError(Codes.BadTcpMessageTooLarge)
        channel, token = _CHANNEL.unpack_from(frame, 8)
        if channel != self.security_token.ChannelId:
            raise UaStatusCodeError(Codes.BadTcpSecureChannelUnknown)
        if token != self.security_token.TokenId:
            self._check_sym_header(ua.SymmetricAlgorithmHeader(TokenId=token))  # pyright: ignore[reportArgumentType]
        plain = self._opened(frame)
        sequence, request = _SEQUENCE.unpack_from(plain)
        self._follow(sequence)
        if self._parts and request != self._parts_of:
            raise UaStatusCodeError(Codes.BadSecurityChecksFailed)
        if frame[3] == _ABORT:
            self._give_up()
            return None
        if frame[3] == _FINAL[3]:
            body = plain[8:]
            if self._parts:
                body = b"".join((*self._parts, body))
                self._give_up()
            return Request(request, Buffer(body))
        self._parts.append(plain[8:])
        self._parts_of = request
        self.unfinished_bytes += len(plain) - 8
        if len(self._parts) >= self._limits.max_chunk_count:
            raise UaStatusCodeError(Codes.BadTcpMessageTooLarge)
        return None

    def _give_up(self) -> None:
        self._parts = []
        self.unfinished_bytes = 0

    def _opened(self, frame: bytes) -> bytes:
        """Return a chunk's sequence header and body, decrypted and proven to come from the peer."""
        crypto: Any = self.security_policy.symmetric_cryptography
        try:
            crypto.use_prev_key = False
            return _open(crypto, frame)
        except InvalidSignature:
            crypto.use_prev_key = True  # a chunk that was under way while the channel was renewed
            return _open(crypto, frame)

    def _follow(self, sequence: int) -> None:
        """Take a sequence number; it is the one after the last, or begins again after the largest."""
        last = self._peer_sequence_number
        begins_again = last is not None and sequence < _WRAPS_TO and last >= _WRAPS_AFTER
        if last is not None and sequence != last + 1 and not begins_again:
            raise UaStatusCodeError(Codes.BadSequenceNumberInvalid)
        self._peer_sequence_number = sequence

    def message_to_binary(
        self, message: bytes, message_type: Any = ua.MessageType.SecureMessage, request_id: int = 0
    ) -> bytes:
        """Return a message in as many chunks as the peer's buffer asks for."""
        if message_type != ua.MessageType.SecureMessage:
            return super().message_to_binary(message, message_type, request_id)
        crypto: Any = self.security_policy.symmetric_cryptography
        block = crypto.encrypted_block_size()
        most = (self._limits.max_send_buffer - _PREFIX) // block * crypto.plain_block_size()
        most -= _SEQUENCE.size + crypto.signature_size() + crypto.min_padding_size()
        channel, token = self.security_token.ChannelId, self.security_token.TokenId
        if len(message) <= most:
            return self._sealed(crypto, _FINAL, channel, token, request_id, message)
        return b"".join(self._chunks(message, most, request_id))

    def chunks(self, message: bytes, request_id: int) -> Iterator[bytes]:
        """Return a large message chunk by chunk, each sealed when it is asked for."""
        crypto: Any = self.security_policy.symmetric_cryptography
        block = crypto.encrypted_block_size()
        most = (self._limits.max_send_buffer - _PREFIX) // block * crypto.plain_block_size()
        most -= _SEQUENCE.size + crypto.signature_size() + crypto.min_padding_size()
        return self._chunks(message, most, request_id)

    def _chunks(self, message: bytes, most: int, request_id: int) -> Iterator[bytes]:
        crypto: Any = self.security_policy.symmetric_cryptography
        channel, token = self.security_token.ChannelId, self.security_token.TokenId
        for end in range(most, len(message) + most, most):
            kind = _MORE if end < len(message) else _FINAL
            yield self._sealed(crypto, kind, channel, token, request_id, message[end - most : end])

    def _sealed(self, crypto: Any, kind: bytes, channel: int, token: int, request: int, body: bytes) -> bytes:
        self._sequence_number = self._sequence_number + 1 if self._sequence_number < (1 << 32) - 1 else 1
        plain = _SEQUENCE.pack(self._sequence_number, request) + body
        plain += crypto.padding(len(plain))
        size = (len(plain) + crypto.signature_size()) // crypto.plain_block_size() * crypto.encrypted_block_size()
        head = _HEADER.pack(kind, _PREFIX + size, channel, token)
        if isinstance(signer := getattr(crypto, "Signer", None), SignerHMac256):
            signature = hmac.digest(signer.key, head + plain, "sha256")
        else:
            signature = crypto.signature(head + plain)
        return head + crypto.encrypt(plain + signature)


def _open(crypto: Any, frame: bytes) -> bytes:
    plain = crypto.decrypt(frame[_PREFIX:])
    size = crypto.vsignature_size()
    if not size:
        return plain
    plain, signature = plain[:-size], plain[-size:]
    verifier = crypto.Prev_Verifier if crypto.use_prev_key else crypto.Verifier
    if isinstance(verifier, VerifierHMac256):
        if not hmac.compare_digest(hmac.digest(verifier.key, frame[:_PREFIX] + plain, "sha256"), signature):
            raise InvalidSignature
    elif verifier is None:
        raise InvalidSignature
    else:
        verifier.verify(frame[:_PREFIX] + plain, signature)
    return crypto.remove_padding(plain)
