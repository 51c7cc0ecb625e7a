"""Keys and certificates, made with `cryptography`, which is an extra."""

import datetime
import ipaddress
from collections.abc import Sequence
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple

from robo.errors import SecurityError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.x509 import Certificate, GeneralName

DAYS = 30
"""How long a name's certificate is valid, unless another time is said: revocation is slow without renewal."""
DAYS_OF_CA = 3650
"""How long the certificate of a CA is valid."""
_LENIENCE = datetime.timedelta(minutes=5)
"""By how much clocks may differ."""


class Pair(NamedTuple):
    """A private key and its certificate, as PEM."""

    key: bytes
    certificate: bytes


class Facts(NamedTuple):
    """What a certificate says."""

    name: str
    serial: str
    not_before: int
    """s since the epoch."""
    not_after: int
    hosts: tuple[str, ...]


def _library() -> tuple[ModuleType, ModuleType, ModuleType, ModuleType]:
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError:
        text = "keys and certificates need cryptography, which is not installed: pip install 'robo-zenoh[security]'"
        raise SecurityError(text) from None
    return x509, hashes, serialization, ec


def make_ca(name: str, days: float = DAYS_OF_CA) -> Pair:
    """A new CA: its key (EC P-256) signs certificates of names, and nothing below them.

    Raises:
        SecurityError: `cryptography` is not installed.
    """
    x509, hashes, _, ec = _library()
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _subject(f"CA {name}")  # a blank is in no other name: who is signed must not be called as who signs
    begin, end = _valid(days)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(end)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    return Pair(_private(key), _public(certificate))


def make_key() -> bytes:
    """A new private key (EC P-256).

    Raises:
        SecurityError: `cryptography` is not installed.
    """
    _, _, _, ec = _library()
    return _private(ec.generate_private_key(ec.SECP256R1()))


def issue(ca: Pair, key: bytes, name: str, hosts: Sequence[str], *, days: float, serves: bool) -> bytes:
    """A certificate for a name, signed by a CA.

    Args:
        ca: who signs.
        key: the name's private key.
        name: becomes the common name, by which rules know it.
        hosts: names and addresses by which others dial it; of whom nobody dials, none.
        days: for how long.
        serves: whether others dial it, as a router; everybody dials.

    Raises:
        SecurityError: `cryptography` is not installed, or a key is none.
    """
    x509, hashes, serialization, _ = _library()
    from cryptography.x509.oid import ExtendedKeyUsageOID

    try:
        own = serialization.load_pem_private_key(key, None)
        authority = serialization.load_pem_private_key(ca.key, None)
        signer = x509.load_pem_x509_certificate(ca.certificate)
    except (ValueError, TypeError):  # what they say may quote the key
        raise SecurityError("a key or the CA's certificate cannot be read: it is damaged or encrypted") from None
    if authority.public_key() != signer.public_key():
        raise SecurityError("the CA's key is not that of the CA's certificate")
    usages = [ExtendedKeyUsageOID.CLIENT_AUTH, *([ExtendedKeyUsageOID.SERVER_AUTH] if serves else [])]
    begin, end = _valid(days)
    builder = (
        x509.CertificateBuilder()
        .subject_name(_subject(name))
        .issuer_name(signer.subject)
        .public_key(own.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(begin)
        .not_valid_after(min(end, signer.not_valid_after_utc))
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer.public_key()), critical=False)
    )
    if hosts:
        builder = builder.add_extension(x509.SubjectAlternativeName([*map(_host, hosts)]), critical=False)
    return _public(builder.sign(authority, hashes.SHA256()))


def facts(certificate: bytes) -> Facts:
    """What a certificate says.

    Raises:
        SecurityError: `cryptography` is not installed, or it is no certificate.
    """
    x509, _, _, _ = _library()
    try:
        found = x509.load_pem_x509_certificate(certificate)
    except ValueError:
        raise SecurityError("it is no certificate") from None
    names = found.subject.get_attributes_for_oid(x509.oid.NameOID.COMMON_NAME)
    try:
        said = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        hosts = tuple(str(one.value) for one in said)
    except x509.ExtensionNotFound:
        hosts = ()
    return Facts(
        names[0].value if names else "",
        f"{found.serial_number:x}",
        int(found.not_valid_before_utc.timestamp()),
        int(found.not_valid_after_utc.timestamp()),
        hosts,
    )


def is_signed_by(certificate: bytes, ca: bytes) -> bool:
    """Whether a CA has signed a certificate.

    Raises:
        SecurityError: `cryptography` is not installed.
    """
    x509, _, _, _ = _library()
    from cryptography.exceptions import InvalidSignature

    try:
        x509.load_pem_x509_certificate(certificate).verify_directly_issued_by(x509.load_pem_x509_certificate(ca))
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def _subject(name: str) -> "object":
    x509, _, _, _ = _library()
    return x509.Name([x509.NameAttribute(x509.oid.NameOID.COMMON_NAME, name)])


def _host(host: str) -> "GeneralName":
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _key_usage(*, signs_certificates: bool) -> "object":
    x509, _, _, _ = _library()
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _valid(days: float) -> tuple[datetime.datetime, datetime.datetime]:
    now = datetime.datetime.now(datetime.UTC)
    return now - _LENIENCE, now + datetime.timedelta(days=days)


def _private(key: "EllipticCurvePrivateKey") -> bytes:
    _, _, serialization, _ = _library()
    encoded: bytes = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return encoded


def _public(certificate: "Certificate") -> bytes:
    _, _, serialization, _ = _library()
    return certificate.public_bytes(serialization.Encoding.PEM)
