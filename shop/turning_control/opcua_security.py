"""OPC UA: how a connection is signed and encrypted, and who the user is (extra ``opcua``).

A server lists its offers: a security policy, a mode, and the kinds of users that it lets in. ``connected`` takes the safest offer
that the given user and certificate fit. It never falls back to an unprotected connection by itself: the list of offers is not
protected, so another machine on the network could have shortened it.
"""

import contextlib
import getpass
import hashlib
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

PASSWORD = "TURNING_OPCUA_PASSWORD"  # environment variable that holds the user's password
KEY_PASSWORD = (
    "TURNING_OPCUA_KEY_PASSWORD"  # that holds the password of the private key, if it has one
)


@dataclass(frozen=True)
class Security:
    """Credentials and settings that protect a connection. Certificates and keys are PEM or DER files."""

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
        if self.policy == "None" and self.mode in ("Sign", "SignAndEncrypt"):
            raise UserError(f"mode {self.mode} needs a security policy other than None")
        if self.policy not in (None, "None") and self.mode == "None":
            raise UserError(f"security policy {self.policy} needs the mode Sign or SignAndEncrypt")
        if self.policy not in (None, "None") and self.certificate is None:
            raise UserError(
                f"security policy {self.policy} needs a certificate and its private key"
            )
        if self.policy == "None" and self.server_certificate is not None:
            raise UserError(
                "without a security policy, nothing proves the server's certificate: leave one of both out"
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
    """Return a user's password from the first line of a file, the environment variable, or a prompt; None without a user."""
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
    """Return the offers of a server's endpoints that can be taken."""
    from asyncua import ua

    modes: dict[Any, Mode] = {
        ua.MessageSecurityMode.None_: "None",
        ua.MessageSecurityMode.Sign: "Sign",
        ua.MessageSecurityMode.SignAndEncrypt: "SignAndEncrypt",
    }
    offers = []
    for endpoint in endpoints:
        policy = _name(endpoint.SecurityPolicyUri)
        mode = modes.get(endpoint.SecurityMode)
        if policy not in POLICIES or mode is None or not endpoint.EndpointUrl.startswith("opc.tcp"):
            continue
        tokens = endpoint.UserIdentityTokens
        password_policies = [
            _name(token.SecurityPolicyUri) if token.SecurityPolicyUri else policy
            for token in tokens
            if token.TokenType == ua.UserTokenType.UserName
        ]
        offers.append(
            Offer(
                policy=policy,
                mode=mode,
                users=tuple(dict.fromkeys(token.TokenType.name for token in tokens)),
                protects_password=mode == "SignAndEncrypt"
                or password_policies[:1] not in ([], ["None"]),
                server_certificate=endpoint.ServerCertificate or b"",
            )
        )
    return offers


def _name(policy_uri: str) -> str:
    return policy_uri.rpartition("#")[2]


def chosen(offers: Sequence[Offer], given: Security) -> Offer:
    """Return the safest offer that fits what is given, or raise UserError with the server's offers."""
    fitting = [offer for offer in offers if _why_not(offer, given) is None]
    if fitting:
        return max(
            fitting, key=lambda offer: (MODES.index(offer.mode), POLICIES.index(offer.policy))
        )
    reasons = [f"{offer}: {_why_not(offer, given)}" for offer in offers] or [
        "nothing that this program knows"
    ]
    raise UserError(f"no offer of the server fits what is given; it offers {'; '.join(reasons)}")


def _why_not(offer: Offer, given: Security) -> str | None:
    """Return why an offer does not fit, or None if it does."""
    if given.policy not in (None, offer.policy):
        return f"--security-policy is {given.policy}"
    if given.mode not in (None, offer.mode):
        return f"--security-mode is {given.mode}"
    if offer.policy in OBSOLETE and given.policy is None:
        return "is obsolete; name it by --security-policy to use it in spite of this"
    accepts_open = "None" in (given.policy, given.mode)
    if offer.policy == "None":
        if given.server_certificate is not None:
            return "does not prove the server's certificate"
        if given.certificate is not None and not accepts_open:
            return "is not protected; give --security-policy None to use it in spite of the certificate"
    elif given.certificate is None:
        return "needs --certificate and --key"
    if given.user is not None:
        if "UserName" not in offer.users:
            return "takes no user with a password"
        if not offer.protects_password and not accepts_open:
            return "would send the password unencrypted; give --security-policy None to accept this"
    elif "Anonymous" not in offer.users and not (
        given.certificate is not None and "Certificate" in offer.users
    ):
        return "needs " + " or ".join(_NEEDS[kind] for kind in offer.users if kind in _NEEDS)
    return None


_NEEDS = {"UserName": "--user", "Certificate": "--certificate and --key, as the user"}


def notice(offer: Offer, given: Security) -> str:
    """Return what is and what is not protected."""
    fingerprint = hashlib.sha256(offer.server_certificate).hexdigest()
    if offer.mode == "None":
        password = ""
        if given.user is not None:
            password = (
                " The password is encrypted."
                if offer.protects_password
                else " The password is sent unencrypted."
            )
        return f"OPC UA: NOT ENCRYPTED, not signed: others on the network can read and change readings and commands.{password}"
    protection = (
        "signed and encrypted"
        if offer.mode == "SignAndEncrypt"
        else "signed, NOT ENCRYPTED: others can read it"
    )
    if given.server_certificate is not None:
        trust = "the server's certificate is the given one"
    else:
        trust = f"the server's certificate is NOT CHECKED (give --server-certificate FILE; its SHA-256 is {fingerprint})"
    return f"OPC UA: {offer.policy}, {offer.mode}: {protection}; {trust}"


@contextlib.contextmanager
def connected(url: str, timeout: float, given: Security) -> Iterator[Any]:
    """Yield asyncua's client, connected by the safest offer that fits, and say on standard error what is not protected.

    UserError if nothing fits; OSError if the connection cannot be made, is refused or is lost.
    """
    from asyncua.sync import Client
    from asyncua.ua.uaerrors import UaError

    try:
        discovery = Client(url, timeout=timeout)
        try:
            offers = offers_of(discovery.connect_and_get_server_endpoints())
        finally:
            discovery.tloop.stop()
        offer = chosen(offers, given)
        _check_server(offer, given)
        print(notice(offer, given), file=sys.stderr, flush=True)
        client = Client(url, timeout=timeout)
        _protect(client, offer, given)
        with client:
            yield client
    except UaError as error:
        raise ConnectionError(f"{url}: {type(error).__name__}: {error}") from error


def _check_server(offer: Offer, given: Security) -> None:
    """Raise ConnectionError unless the server presents the certificate that is trusted."""
    if given.server_certificate is None:
        return
    trusted = _certificate(given.server_certificate)
    from cryptography.hazmat.primitives.serialization import Encoding

    # What is compared here is not proven yet: the connection that follows can only be opened with this certificate's key.
    if not offer.server_certificate.startswith(trusted.public_bytes(Encoding.DER)):
        presented = hashlib.sha256(offer.server_certificate).hexdigest()
        raise ConnectionError(
            f"the server presents another certificate (SHA-256 {presented}) than {given.server_certificate}"
        )


def _certificate(path: Path) -> Any:
    """Return the certificate in a PEM or DER file; UserError if there is none."""
    from cryptography import x509

    content = path.read_bytes()
    try:
        return (
            x509.load_pem_x509_certificate(content)
            if b"-----BEGIN" in content
            else x509.load_der_x509_certificate(content)
        )
    except ValueError as error:
        raise UserError(f"{path} holds no certificate in PEM or DER: {error}") from error


def _private_key(path: Path, password: str | None) -> bytes:
    """Return the private key in a PEM or DER file, as PEM without a password; UserError if there is none."""
    from cryptography.hazmat.primitives import serialization

    content = path.read_bytes()
    secret = password.encode() if password else None
    try:
        if b"-----BEGIN" in content:
            key = serialization.load_pem_private_key(content, password=secret)
        else:
            key = serialization.load_der_private_key(content, password=secret)
    except (
        ValueError,
        TypeError,
    ) as error:  # TypeError: a password is missing, or one is given in vain
        raise UserError(
            f"{path} holds no private key that can be read ({KEY_PASSWORD} holds its password): {error}"
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
    from cryptography import x509
    from cryptography.hazmat.primitives.serialization import Encoding

    if given.user is not None:
        client.set_user(given.user)
        client.set_password(given.password or "")
    if given.certificate is None or given.key is None:
        return

    certificate = _certificate(given.certificate)
    key = CertProperties(_private_key(given.key, given.key_password), "pem")
    own = CertProperties(certificate.public_bytes(Encoding.PEM), "pem")
    with contextlib.suppress(
        x509.ExtensionNotFound
    ):  # servers compare this address with the certificate's
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        for address in names.get_values_for_type(x509.UniformResourceIdentifier)[:1]:
            client.application_uri = address
    if given.user is None and "Anonymous" not in offer.users:
        client.load_client_certificate(own.path_or_content, "pem")
        client.load_private_key(key.path_or_content, None, "pem")
    if offer.policy != "None":
        policy = getattr(security_policies, f"SecurityPolicy{offer.policy}")
        server = CertProperties(_first_certificate(offer.server_certificate), "der")
        mode = getattr(ua.MessageSecurityMode, offer.mode)
        client.tloop.post(
            client.aio_obj.set_security(policy, own, key, server_certificate=server, mode=mode)
        )


def _first_certificate(chain: bytes) -> bytes:
    """Return the first of certificates in a row, whose DER begins with a tag and its length."""
    if len(chain) < 2 or chain[1] < 0x80:
        return chain
    length_bytes = chain[1] - 0x80
    length = int.from_bytes(chain[2 : 2 + length_bytes], "big")
    return chain[: 2 + length_bytes + length]
