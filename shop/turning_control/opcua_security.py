"""OPC UA: how a connection is signed and encrypted, and who the user is (extra ``opcua``).

A server lists its offers: a security policy, a mode, and the kinds of users that it lets in.
``connected`` takes the safest offer that the given user and certificate fit. It never falls back to
an unprotected connection by itself: the list of offers is not protected, so another machine on the
network could have shortened it.

``opcua.py`` reads and writes the nodes.
"""

import contextlib
import getpass
import hashlib
import logging
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

from turning_env.console import UserError

Mode = Literal["None", "Sign", "SignAndEncrypt"]
MODES: tuple[Mode, ...] = get_args(Mode)  # the safest last

POLICIES = (
    "None",
    "Basic128Rsa15",
    "Basic256",
    "Basic256Sha256",
    "Aes128Sha256RsaOaep",
    "Aes256Sha256RsaPss",
)
"""Security policies that can be named, the safest last."""
OBSOLETE = ("Basic128Rsa15", "Basic256")  # broken: never taken unless named

# Environment variables that hold the user's password, and that of the private key if it has one.
PASSWORD = "TURNING_OPCUA_PASSWORD"
KEY_PASSWORD = "TURNING_OPCUA_KEY_PASSWORD"

# Options that a kind of user needs.
NEEDS = {"UserName": "--user", "Certificate": "--certificate and --key, as the user"}

REFUSED_USER = "the server refuses the user: check --user and the password"
REFUSED_CERTIFICATE = "the server refuses the certificate: let it trust --certificate FILE"
REFUSALS = {
    "BadUserAccessDenied": REFUSED_USER,
    "BadIdentityTokenInvalid": REFUSED_USER,
    "BadIdentityTokenRejected": REFUSED_USER,
    "BadCertificateUntrusted": REFUSED_CERTIFICATE,
    "BadSecurityChecksFailed": REFUSED_CERTIFICATE,
}
"""Likely causes of errors of a server, by their names (OPC UA part 4, 7.39)."""


@dataclass(frozen=True)
class Security:
    """Credentials and settings that protect a connection.

    Certificates and keys are PEM or DER files. UserError if the values contradict one another.
    """

    user: str | None = None
    password: str | None = field(default=None, repr=False)
    certificate: Path | None = None  # of this program
    key: Path | None = None  # its private key
    key_password: str | None = field(default=None, repr=False)
    server_certificate: Path | None = None  # the only one that is trusted
    policy: str | None = None  # one of ``POLICIES``; None: the safest that fits
    mode: Mode | None = None  # None: the safest that fits

    def __post_init__(self) -> None:
        if (self.certificate is None) != (self.key is None):
            raise UserError(
                "a certificate and its private key belong together: give both, or neither"
            )
        if self.policy == "None":
            if self.mode in ("Sign", "SignAndEncrypt"):
                raise UserError(f"mode {self.mode} needs a security policy other than None")
            if self.server_certificate is not None:
                raise UserError(
                    "without a security policy, nothing proves the server's certificate: "
                    "leave one of both out"
                )
        elif self.policy is not None:
            if self.mode == "None":
                raise UserError(
                    f"security policy {self.policy} needs the mode Sign or SignAndEncrypt"
                )
            if self.certificate is None:
                raise UserError(
                    f"security policy {self.policy} needs a certificate and its private key"
                )


@dataclass(frozen=True)
class Offer:
    """One way in which a server lets clients in."""

    policy: str
    mode: Mode
    users: tuple[str, ...]  # kinds: Anonymous, UserName, Certificate
    protects_password: bool
    server_certificate: bytes  # DER

    def __str__(self) -> str:
        """Describe the offer."""
        return f"policy {self.policy}, mode {self.mode}, users {'/'.join(self.users) or 'none'}"


def read_password(user: str | None, file: Path | None) -> str | None:
    """Return a user's password, or None without a user.

    It comes from the first line of a file, the environment variable, or a prompt.
    """
    if user is None:
        return None
    if file is not None:
        return file.read_text("utf-8").partition("\n")[0].rstrip("\r")
    if PASSWORD in os.environ:
        return os.environ[PASSWORD]
    if sys.stdin.isatty():
        return getpass.getpass(f"Password of {user}: ", stream=sys.stderr)
    raise UserError(
        f"the password of {user} is missing: give --password-file FILE, or set {PASSWORD}"
    )


def offers_of(endpoints: Sequence[Any]) -> list[Offer]:
    """Return the offers of a server's endpoints, without those that this program cannot take."""
    offers = []
    for endpoint in endpoints:
        offer = _offer(endpoint)
        if offer is not None:
            offers.append(offer)
    return offers


def _offer(endpoint: Any) -> Offer | None:
    """Return the offer of a server's endpoint; None if this program cannot take it."""
    from asyncua import ua

    modes: dict[Any, Mode] = {
        ua.MessageSecurityMode.None_: "None",
        ua.MessageSecurityMode.Sign: "Sign",
        ua.MessageSecurityMode.SignAndEncrypt: "SignAndEncrypt",
    }
    policy = _policy_name(endpoint.SecurityPolicyUri)
    mode = modes.get(endpoint.SecurityMode)
    if policy not in POLICIES or mode is None or not endpoint.EndpointUrl.startswith("opc.tcp"):
        return None

    # A password is encrypted by the policy of its token, or else by that of the connection.
    password_policy = "None"
    users: list[str] = []
    for token in endpoint.UserIdentityTokens:
        if token.TokenType == ua.UserTokenType.UserName and "UserName" not in users:
            token_policy = token.SecurityPolicyUri
            password_policy = _policy_name(token_policy) if token_policy else policy
        if token.TokenType.name not in users:
            users.append(token.TokenType.name)
    return Offer(
        policy=policy,
        mode=mode,
        users=tuple(users),
        protects_password=mode == "SignAndEncrypt" or password_policy != "None",
        server_certificate=endpoint.ServerCertificate or b"",
    )


def _policy_name(uri: str) -> str:
    return uri.rpartition("#")[2]


def chosen(offers: Sequence[Offer], given: Security) -> Offer:
    """Return the safest offer that fits what is given, or raise UserError with the offers."""

    def safety(offer: Offer) -> tuple[int, int]:
        mode = MODES.index(offer.mode)
        policy = POLICIES.index(offer.policy)
        return mode, policy

    fitting = []
    reasons = []
    for offer in offers:
        reason = _why_not(offer, given)
        if reason is None:
            fitting.append(offer)
        else:
            reasons.append(f"{offer}: {reason}")
    if fitting:
        return max(fitting, key=safety)
    listed = "; ".join(reasons) or "nothing that this program knows"
    raise UserError(f"no offer of the server fits what is given; it offers {listed}")


def _why_not(offer: Offer, given: Security) -> str | None:
    """Return why an offer does not fit, or None if it does."""
    if given.policy not in (None, offer.policy):
        return f"--security-policy is {given.policy}"
    if given.mode not in (None, offer.mode):
        return f"--security-mode is {given.mode}"
    if offer.policy in OBSOLETE and given.policy is None:
        return "is obsolete; name it by --security-policy to use it in spite of this"
    reasons = []
    for reason in (_why_not_protected(offer, given), _why_not_user(offer, given)):
        if reason:
            reasons.append(reason)
    return ", ".join(reasons) or None


def _why_not_protected(offer: Offer, given: Security) -> str | None:
    """Return why the protection of an offer does not fit the certificates, or None if it does."""
    if offer.policy != "None":
        return "needs --certificate and --key" if given.certificate is None else None
    if given.server_certificate is not None:
        return "does not prove the server's certificate"
    if given.certificate is not None and not _accepts_open(given):
        return "is not protected; give --security-policy None to use it in spite of the certificate"
    return None


def _why_not_user(offer: Offer, given: Security) -> str | None:
    """Return why an offer does not let the user in, or None if it does."""
    if given.user is not None:
        if "UserName" not in offer.users:
            return "takes no user with a password"
        if not offer.protects_password and not _accepts_open(given):
            return "would send the password unencrypted; give --security-policy None to accept this"
        return None
    is_certified = given.certificate is not None and "Certificate" in offer.users
    if "Anonymous" in offer.users or is_certified:
        return None
    return "needs " + " or ".join(NEEDS[kind] for kind in offer.users if kind in NEEDS)


def _accepts_open(given: Security) -> bool:
    """Return whether the user has named an unprotected connection."""
    return "None" in (given.policy, given.mode)


def notice(offer: Offer, given: Security) -> str:
    """Return what is and what is not protected."""
    if offer.mode == "None":
        text = (
            "OPC UA: NOT ENCRYPTED, not signed: others on the network can read and change "
            "readings and commands."
        )
        if given.user is None:
            return text
        sent = "is encrypted" if offer.protects_password else "is sent unencrypted"
        return f"{text} The password {sent}."

    protection = "signed and encrypted"
    if offer.mode == "Sign":
        protection = "signed, NOT ENCRYPTED: others can read it"
    trust = "the server's certificate is the given one"
    if given.server_certificate is None:
        fingerprint = hashlib.sha256(offer.server_certificate).hexdigest()
        trust = (
            "the server's certificate is NOT CHECKED "
            f"(give --server-certificate FILE; its SHA-256 is {fingerprint})"
        )
    return f"OPC UA: {offer.policy}, {offer.mode}: {protection}; {trust}"


@contextlib.contextmanager
def connected(url: str, timeout: float, given: Security) -> Iterator[Any]:
    """Yield asyncua's client, connected by the safest offer that fits.

    What is not protected is printed on stderr.

    Raises:
        UserError: No offer fits.
        OSError: The connection cannot be made, is refused or is lost.
    """
    from asyncua.sync import Client
    from asyncua.ua.uaerrors import UaError

    # Faults come as exceptions; asyncua logs them as well.
    logging.getLogger("asyncua.client").setLevel(logging.ERROR)
    try:
        offer = chosen(_offers_at(url, timeout), given)
        _check_server(offer, given)
        print(notice(offer, given), file=sys.stderr, flush=True)
        client = Client(url, timeout=timeout)
        _protect(client, offer, given)
        with client:
            yield client
    except UaError as error:
        name = type(error).__name__
        raise ConnectionError(f"{url}: {name}: {REFUSALS.get(name, error)}") from error


def _offers_at(url: str, timeout: float) -> list[Offer]:
    """Return the offers of the server at an address; OSError if none answers."""
    from asyncua.sync import Client

    discovery = Client(url, timeout=timeout)
    try:
        return offers_of(discovery.connect_and_get_server_endpoints())
    except OSError as error:
        # A timeout has no text.
        raise ConnectionError(f"{url} does not answer: {error or 'timeout'}") from error
    finally:
        discovery.tloop.stop()


def _check_server(offer: Offer, given: Security) -> None:
    """Raise ConnectionError unless the server presents the certificate that is trusted."""
    if given.server_certificate is None:
        return
    trusted = _certificate(given.server_certificate)
    from cryptography.hazmat.primitives.serialization import Encoding

    # This comparison proves nothing yet. The proof is the connection that follows: it can only be
    # opened with this certificate's key.
    if not offer.server_certificate.startswith(trusted.public_bytes(Encoding.DER)):
        presented = hashlib.sha256(offer.server_certificate).hexdigest()
        raise ConnectionError(
            f"the server presents another certificate (SHA-256 {presented}) "
            f"than {given.server_certificate}"
        )


def _is_pem(content: bytes) -> bool:
    return b"-----BEGIN" in content


def _certificate(path: Path) -> Any:
    """Return the certificate in a PEM or DER file; UserError if there is none."""
    from cryptography import x509

    content = path.read_bytes()
    try:
        if _is_pem(content):
            return x509.load_pem_x509_certificate(content)
        return x509.load_der_x509_certificate(content)
    except ValueError as error:
        raise UserError(f"{path} holds no certificate in PEM or DER: {error}") from error


def _private_key(path: Path, password: str | None) -> bytes:
    """Return the private key in a PEM or DER file, as PEM without a password.

    UserError if there is none.
    """
    from cryptography.hazmat.primitives import serialization

    content = path.read_bytes()
    secret = password.encode() if password else None
    try:
        if _is_pem(content):
            key = serialization.load_pem_private_key(content, password=secret)
        else:
            key = serialization.load_der_private_key(content, password=secret)
    # TypeError: a password is missing, or one is given in vain.
    except (ValueError, TypeError) as error:
        raise UserError(
            f"{path} holds no private key that can be read "
            f"({KEY_PASSWORD} holds its password): {error}"
        ) from error
    return key.private_bytes(
        encoding=serialization.Encoding.PEM,
        format=serialization.PrivateFormat.PKCS8,
        encryption_algorithm=serialization.NoEncryption(),
    )


def _protect(client: Any, offer: Offer, given: Security) -> None:
    """Set the client's certificate, policy and user."""
    from asyncua import ua
    from asyncua.crypto import security_policies
    from asyncua.crypto.uacrypto import CertProperties
    from cryptography.hazmat.primitives.serialization import Encoding

    if given.user is not None:
        client.set_user(given.user)
        client.set_password(given.password or "")
    if given.certificate is None or given.key is None:
        return

    certificate = _certificate(given.certificate)
    client_certificate = CertProperties(certificate.public_bytes(Encoding.PEM), "pem")
    client_key = CertProperties(_private_key(given.key, given.key_password), "pem")
    address = _address(certificate)
    if address is not None:
        client.application_uri = address
    if given.user is None and "Anonymous" not in offer.users:
        client.load_client_certificate(client_certificate.path_or_content, "pem")
        client.load_private_key(client_key.path_or_content, None, "pem")
    if offer.policy != "None":
        setting = client.aio_obj.set_security(
            getattr(security_policies, f"SecurityPolicy{offer.policy}"),
            client_certificate,
            client_key,
            server_certificate=CertProperties(_first_certificate(offer.server_certificate), "der"),
            mode=getattr(ua.MessageSecurityMode, offer.mode),
        )
        client.tloop.post(setting)


def _address(certificate: Any) -> str | None:
    """Return the address in a certificate, which servers compare with that of the client."""
    from cryptography import x509

    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return None
    addresses: list[str] = names.get_values_for_type(x509.UniformResourceIdentifier)
    return addresses[0] if addresses else None


def _first_certificate(chain: bytes) -> bytes:
    """Return the first of certificates in a row.

    Each is in DER: a byte of tag, then the length. Up to 127 it is one byte; otherwise the lower
    seven bits of this byte are the number of bytes of the length that follow (X.690, 8.1.3).
    """
    if len(chain) < 2 or chain[1] < 0x80:
        return chain
    length_bytes = chain[1] - 0x80
    length = int.from_bytes(chain[2 : 2 + length_bytes], "big")
    return chain[: 2 + length_bytes + length]
