"""The OPC UA adapter with a server on this machine."""

import contextlib
import datetime
import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from turning_control import opcua
from turning_control.__main__ import main
from turning_control.core import Controller, Status
from turning_control.opcua_security import PASSWORD, Security

from tests.walking import until
from turning_env import Scenario
from turning_env.console import UserError
from turning_env.scoring.adapt import as_factory

STEADY = {
    "spindle_speed": 400.0,
    "feed_velocity": 100.0,
    "in_feed": True,
    "cutting": True,
    "power": 4.0,
    "thrust_force": 700.0,
    "edge": 0,
}
COMMANDS = {"adaptive_feed": 0.1, "spindle_override": 0.1, "status": 0, "alive": 0}
INTERVAL = 0.05


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[str, Path, dict[str, Any]]]:
    """Yield the URL of a server, the file that names its nodes, and the nodes."""
    with serving(tmp_path, lambda server: None) as parts:
        yield parts


@contextlib.contextmanager
def serving(
    tmp_path: Path, protect: Callable[[Any], None]
) -> Iterator[tuple[str, Path, dict[str, Any]]]:
    """Yield the same of a server that ``protect`` sets up."""
    asyncua = pytest.importorskip("asyncua.sync")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"opc.tcp://127.0.0.1:{free.getsockname()[1]}"
    server = asyncua.Server()
    server.set_endpoint(url)
    protect(server)
    index = server.register_namespace("lathe")
    nodes = {
        name: server.nodes.objects.add_variable(index, name, value)
        for name, value in {**STEADY, **COMMANDS}.items()
    }
    for name in COMMANDS:
        nodes[name].set_writable()
    path = tmp_path / "nodes.toml"
    ids = {name: f'{name} = "{node.nodeid.to_string()}"' for name, node in nodes.items()}
    parts = "[readings]", *map(ids.get, STEADY), "[commands]", *map(ids.get, COMMANDS)
    path.write_text("\n".join(map(str, parts)))
    with server:
        yield url, path, nodes


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # asyncua's own
def test_the_policy_commands_a_server_and_falls_back_to_the_safe_feed(
    served: tuple[str, Path, dict[str, Any]],
) -> None:
    url, path, nodes = served
    policy = as_factory(lambda observations: np.full((len(observations), 2), -0.1, np.float32))
    controller, stop = Controller(Scenario.load("rough_turning"), policy), threading.Event()
    thread = threading.Thread(
        target=opcua.drive, args=(controller, url, path, INTERVAL, lambda: not stop.is_set())
    )

    def status() -> int:
        nodes["power"].write_value(4.0 + 0.1 * np.random.default_rng(time.time_ns()).random())
        nodes["thrust_force"].write_value(700.0 + np.random.default_rng(time.time_ns()).random())
        return int(nodes["status"].read_value())

    thread.start()
    try:
        until(lambda: status() in (Status.POLICY, Status.SHIELD))
        assert nodes["adaptive_feed"].read_value() > 0.1
        alive = nodes["alive"].read_value()
        until(lambda: nodes["alive"].read_value() != alive)
        nodes["spindle_speed"].write_value(0.0)
        until(
            lambda: (
                nodes["status"].read_value() == Status.OPERATOR
                and nodes["adaptive_feed"].read_value() == 0.0
            )
        )
        nodes["spindle_speed"].write_value(400.0)
        nodes["power"].write_value(math.nan)
        until(lambda: nodes["status"].read_value() == Status.SAFE)
    finally:
        stop.set()
        thread.join(30.0)
    assert not thread.is_alive()
    assert nodes["adaptive_feed"].read_value() == pytest.approx(controller.safe_feed)
    assert nodes["status"].read_value() == Status.SAFE


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[readings]\nload = 'i=1'", "load"),
        ("[readings]\nspindle_speed = 'i=1'", "feed_velocity"),
        (
            "\n".join(
                [
                    "[readings]",
                    *(f"{name} = 'i=1'" for name in opcua.NEEDED),
                    "[commands]",
                    "feed = 'i=2'",
                ]
            ),
            "feed",
        ),
    ],
)
def test_a_file_of_nodes_that_does_not_fit_is_refused(
    text: str, named: str, tmp_path: Path
) -> None:
    path = tmp_path / "nodes.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=named):
        opcua.load_nodes(path)


def certified(folder: Path, name: str) -> tuple[Path, Path]:
    """Write a self-signed certificate and its private key; return their paths."""
    pytest.importorskip("asyncua")
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import rsa
    from cryptography.x509.oid import NameOID

    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
    )
    builder = builder.serial_number(x509.random_serial_number())
    builder = builder.not_valid_before(now - datetime.timedelta(days=1)).not_valid_after(
        now + datetime.timedelta(days=1)
    )
    address = x509.UniformResourceIdentifier(f"urn:{name}")
    builder = builder.add_extension(
        x509.SubjectAlternativeName([address, x509.DNSName(socket.gethostname())]), critical=False
    )
    pem = serialization.Encoding.PEM
    certificate_path, key_path = folder / f"{name}.pem", folder / f"{name}_key.pem"
    certificate_path.write_bytes(builder.sign(key, hashes.SHA256()).public_bytes(pem))
    plain = serialization.NoEncryption()
    key_path.write_bytes(key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain))
    return certificate_path, key_path


class Guarded:
    """A server that wants the user "turner" with a password, or the certificate of a client, over protected connections."""

    def __init__(self, folder: Path) -> None:
        self.certificate, self.key = certified(folder, "server")
        self.client_certificate, self.client_key = certified(folder, "client")
        self.other_certificate, _ = certified(folder, "other")
        self.policies = [
            "Basic256Sha256_Sign",
            "Basic256Sha256_SignAndEncrypt",
            "Aes128Sha256RsaOaep_SignAndEncrypt",
        ]
        self.tokens = ["UserNameIdentityToken"]

    def protect(self, server: Any) -> None:
        from asyncua import ua
        from asyncua.crypto.permission_rules import User, UserRole

        class Users:
            def get_user(
                self,
                iserver: Any,
                username: Any = None,
                password: Any = None,
                certificate: Any = None,
            ) -> Any:
                known = (username, password) == ("turner", "secret") or (
                    username is None and certificate is not None
                )
                return User(role=UserRole.User) if known else None

        server.load_certificate(str(self.certificate))
        server.load_private_key(str(self.key))
        server.set_security_policy([getattr(ua.SecurityPolicyType, name) for name in self.policies])
        server.set_identity_tokens([getattr(ua, name) for name in self.tokens])
        server.aio_obj.iserver.set_user_manager(Users())

    def security(self, **changed: Any) -> Security:
        given = {
            "user": "turner",
            "password": "secret",
            "certificate": self.client_certificate,
            "key": self.client_key,
        }
        return Security(**(given | {"server_certificate": self.certificate} | changed))


def driven(url: str, nodes: Path, security: Security) -> None:
    """Drive a server for three cycles."""
    policy = as_factory(lambda observations: np.full((len(observations), 2), -0.1, np.float32))
    cycles = iter([True, True, True, False])
    opcua.drive(
        Controller(Scenario.load("rough_turning"), policy),
        url,
        nodes,
        INTERVAL,
        lambda: next(cycles),
        security,
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_guarded_server_is_driven_with_user_and_certificate_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    guarded = Guarded(tmp_path)
    with serving(tmp_path, guarded.protect) as (url, nodes, values):
        driven(url, nodes, guarded.security())
        assert values["status"].read_value() == Status.SAFE
        said = capsys.readouterr().err
        assert "SignAndEncrypt" in said
        assert "NOT" not in said

        driven(url, nodes, guarded.security(server_certificate=None, mode="Sign"))
        said = capsys.readouterr().err
        assert "NOT ENCRYPTED" in said
        assert "NOT CHECKED" in said

        for lacking in (
            Security(),
            Security(user="turner", password="secret"),
            guarded.security(user=None),
            guarded.security(policy="Aes256Sha256RsaPss"),
        ):
            with pytest.raises(UserError, match="Basic256Sha256, mode SignAndEncrypt"):
                driven(url, nodes, lacking)
        with pytest.raises(OSError, match="another certificate"):
            driven(url, nodes, guarded.security(server_certificate=guarded.other_certificate))
        with pytest.raises(OSError, match=r"BadUserAccessDenied|BadIdentityToken"):
            driven(url, nodes, guarded.security(password="guess"))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_certificate_can_be_the_user(tmp_path: Path) -> None:
    guarded = Guarded(tmp_path)
    guarded.tokens = ["X509IdentityToken"]
    with serving(tmp_path, guarded.protect) as (url, nodes, values):
        driven(url, nodes, guarded.security(user=None, password=None))
        assert values["status"].read_value() == Status.SAFE


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_certificate_is_never_given_up_for_an_open_connection(
    served: tuple[str, Path, dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url, nodes, _ = served
    guarded = Guarded(tmp_path)
    with pytest.raises(UserError, match="not protected"):
        driven(url, nodes, guarded.security(user=None, server_certificate=None))
    with pytest.raises(UserError, match="password unencrypted"):
        driven(url, nodes, Security(user="turner", password="secret"))
    capsys.readouterr()
    driven(url, nodes, Security(user="turner", password="secret", policy="None"))
    assert "sent unencrypted" in capsys.readouterr().err


def test_what_does_not_belong_together_is_a_mistake(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "client.pem"
    for given in (
        {"certificate": path},
        {"key": path},
        {"policy": "Basic256Sha256"},
        {"policy": "None", "mode": "Sign"},
        {"policy": "None", "server_certificate": path},
    ):
        with pytest.raises(UserError):
            Security(**given)  # type: ignore[arg-type]
    monkeypatch.delenv(PASSWORD, raising=False)
    options = [
        "--policy",
        "programmed",
        "--url",
        "opc.tcp://127.0.0.1:1",
        "--nodes",
        "nodes.toml",
        "--user",
        "turner",
    ]
    assert main(["opcua", *options]) == 2  # no password, and no terminal to ask
    assert "secret" not in repr(Security(user="turner", password="secret"))
