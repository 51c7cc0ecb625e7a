"""Whether an endpoint over TLS lets this process in, and why not: Zenoh itself only says that it did not connect."""

import socket
import ssl
from pathlib import Path

from robo.wire import identity, tcp
from robo.wire.identity import CA, CERTIFICATE, KEY


def refused(endpoint: str, folder: str, within: float) -> str:
    """As `refusal`, of a process that has the name of a folder; empty where nothing is wrong, or nobody answers."""
    if not endpoint.startswith("tls/"):
        return ""
    try:
        return refusal(endpoint, identity.folder_of(folder), within) or ""
    except OSError:
        return ""


_READS_WITHIN = 0.3
"""How long the other side has for its refusal, s: TLS 1.3 tells it after the handshake."""


def refusal(endpoint: str, folder: Path, within: float) -> str | None:
    """Why what listens at an endpoint is not joined, in a sentence; None where its handshake goes well.

    Args:
        endpoint: over TLS, in Zenoh's form.
        folder: of this process's own name.
        within: how long each step may take, s.

    Raises:
        OSError: nobody answers there.
    """
    address = tcp.address_of(endpoint)
    if address is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.load_verify_locations(folder / CA)
    context.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    with socket.create_connection(address, timeout=within) as plain:
        try:
            with context.wrap_socket(plain, server_hostname=address[0]) as secured:
                secured.settimeout(_READS_WITHIN)
                secured.recv(1)
        except ssl.SSLCertVerificationError as error:
            return _of_router(error, address[0])
        except TimeoutError:
            return None  # it waits for a word of Zenoh's
        except ssl.SSLError as error:
            return _of_us(error.reason or "")
        except ConnectionError:
            return None
    return None


def _of_router(error: ssl.SSLCertVerificationError, host: str) -> str:
    match error.verify_code:  # OpenSSL's numbers, X509_V_ERR_…
        case 10:
            return "the certificate of the router there has expired: `robo security renew` on the router's side"
        case 9:
            return "the certificate of the router there is not valid yet: does a clock go wrong?"
        case 62 | 64:
            return f"the certificate of the router there is not for {host}: `robo security renew ROUTER --host {host}`"
        case 19 | 20 | 21 | 18:
            return "the router there is not of this network: another CA has made its certificate"
        case _:
            return f"the certificate of the router there is not accepted ({error.verify_message})"


_REFUSED = {
    "TLSV13_ALERT_CERTIFICATE_REQUIRED": "it wants a certificate, and got none",
    "TLSV1_ALERT_UNKNOWN_CA": "it does not know the CA of this certificate: this name is of another network",
    "SSLV3_ALERT_CERTIFICATE_EXPIRED": "the certificate used here has expired, or is not valid yet",
    "SSLV3_ALERT_UNSUPPORTED_CERTIFICATE": "the certificate used here is not one for dialling",
    "SSLV3_ALERT_BAD_CERTIFICATE": "it takes the certificate used here for a bad one",
    "SSLV3_ALERT_CERTIFICATE_UNKNOWN": "it does not accept the certificate used here",
}


def _of_us(reason: str) -> str:
    if reason in ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "RECORD_LAYER_FAILURE", "UNEXPECTED_EOF_WHILE_READING"):
        return "what listens there does not speak TLS: is security on there?"
    return f"the router there refuses: {_REFUSED.get(reason, reason.lower().replace('_', ' '))}"
