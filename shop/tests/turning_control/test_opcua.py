"""The OPC UA adapter with a server on this machine."""

import contextlib
import datetime
import math
import os
import socket
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from turning_control import opcua
from turning_control.__main__ import main
from turning_control.core import Controller, Status
from turning_control.opcua_security import PASSWORD, Security

from leaderboard.adapt import as_factory
from tests.walking import until
from turning_env import Scenario
from turning_env.console import UserError
from turning_env.policy import PolicyFactory

STEADY = {
    "spindle_speed": 400.0,
    "feed_velocity": 100.0,
    "in_feed": True,
    "cutting": True,
    "power": 4.0,
    "thrust_force": 700.0,
    "edge": 0,
}
COMMANDS = {
    "adaptive_feed": 0.1,
    "spindle_override": 0.1,
    "status": 0,
    "alive": 0,
}
INTERVAL = 0.05


class Lathe(NamedTuple):
    """A control that serves OPC UA."""

    url: str
    plan: Path  # file that names the nodes
    nodes: dict[str, Any]

    def value(self, name: str) -> Any:
        return self.nodes[name].read_value()


@pytest.fixture(scope="module")
def lathe(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lathe]:
    """Yield a control that lets everybody in; a server needs more than a second to start."""
    with serving(tmp_path_factory.mktemp("lathe"), lambda server: None) as lathe:
        yield lathe


@contextlib.contextmanager
def serving(tmp_path: Path, protect: Callable[[Any], None]) -> Iterator[Lathe]:
    """Yield a control whose server ``protect`` sets up."""
    asyncua = pytest.importorskip("asyncua.sync")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"opc.tcp://127.0.0.1:{free.getsockname()[1]}"
    server = asyncua.Server()
    server.set_endpoint(url)
    protect(server)
    index = server.register_namespace("lathe")
    nodes = {}
    for name, value in {**STEADY, **COMMANDS}.items():
        nodes[name] = server.nodes.objects.add_variable(index, name, value)
    for name in COMMANDS:
        nodes[name].set_writable()

    def lines(names: Iterable[str]) -> list[str]:
        return [f'{name} = "{nodes[name].nodeid.to_string()}"' for name in names]

    plan = tmp_path / "nodes.toml"
    plan.write_text("\n".join(["[readings]", *lines(STEADY), "[commands]", *lines(COMMANDS)]))
    with server:
        yield Lathe(url, plan, nodes)


def scenario_of_a_control() -> Scenario:
    """Return a scenario with the control interval of these tests."""
    scenario = Scenario.load("rough_turning")
    control = scenario.control.model_copy(update={"interval": INTERVAL})
    return scenario.model_copy(update={"control": control})


def steady_policy() -> PolicyFactory:
    """Return a policy that lowers speed and feed a little."""
    return as_factory(lambda observations: np.full((len(observations), 2), -0.1, np.float32))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # asyncua's own
def test_the_policy_commands_a_server_and_falls_back_to_the_safe_feed(lathe: Lathe) -> None:
    controller = Controller(scenario_of_a_control(), steady_policy())
    stop = threading.Event()
    thread = threading.Thread(
        target=opcua.drive,
        args=(controller, lathe.url, lathe.plan, INTERVAL, lambda: not stop.is_set()),
    )
    random = np.random.default_rng(0)
    bad: dict[str, float] = {}
    good = dict(STEADY)

    def status() -> int:
        # Sensors that work never read the same twice.
        good["power"] = 4.0 + 0.1 * random.random()
        good["thrust_force"] = 700.0 + random.random()
        # The feed follows its command at once.
        good["feed_velocity"] = 400.0 * 0.6 * lathe.value("adaptive_feed")
        for name, value in {**good, **bad}.items():
            lathe.nodes[name].write_value(value)
        return int(lathe.value("status"))

    def is_stopped() -> bool:
        status()
        is_with_operator = lathe.value("status") == Status.OPERATOR
        return bool(is_with_operator and lathe.value("adaptive_feed") == 0.0)

    thread.start()
    try:
        until(lambda: status() in (Status.POLICY, Status.SHIELD))
        assert lathe.value("adaptive_feed") > 0.1
        alive = lathe.value("alive")
        until(lambda: lathe.value("alive") != alive)

        bad["spindle_speed"] = 0.0
        until(is_stopped)

        for name in ("power", "spindle_speed", "feed_velocity"):
            bad.clear()
            until(lambda: status() in (Status.POLICY, Status.SHIELD))
            bad[name] = math.nan
            until(lambda: status() == Status.SAFE)
            assert lathe.value("adaptive_feed") <= controller.safe_feed
        bad.clear()
        until(lambda: status() in (Status.POLICY, Status.SHIELD))
        # The gateway freezes.
        until(lambda: lathe.value("status") == Status.SAFE)
    finally:
        stop.set()
        thread.join(30.0)
    assert not thread.is_alive()
    assert lathe.value("adaptive_feed") == pytest.approx(controller.safe_feed)
    assert lathe.value("status") == Status.SAFE


STAMP = datetime.datetime(2030, 1, 1, tzinfo=datetime.UTC)


def stamps(**seconds: float | None) -> dict[str, datetime.datetime | None]:
    """Return timestamps by name, some seconds after ``STAMP``."""
    stamps: dict[str, datetime.datetime | None] = {}
    for name, second in seconds.items():
        stamps[name] = None if second is None else STAMP + datetime.timedelta(seconds=second)
    return stamps


def test_ages_are_unknown_until_timestamps_advance() -> None:
    ages = opcua.Ages()
    month = -30.0 * 86400.0
    assert ages.of(stamps(power=month), now=5.0) == {"power": math.inf}
    assert ages.of(stamps(power=month), now=6.0) == {"power": math.inf}
    assert ages.of(stamps(power=month + 1.0), now=7.0) == {"power": 0.0}


def test_an_age_grows_while_the_timestamp_stands() -> None:
    ages = opcua.Ages()
    ages.of(stamps(power=0.0, position=0.0), now=0.0)
    ages.of(stamps(power=1.0, position=1.0), now=1.0)
    assert ages.of(stamps(power=2.0, position=1.0), now=2.0) == {"power": 0.0, "position": 1.0}
    assert ages.of(stamps(power=2.0, position=1.0), now=2.5) == {"power": 0.5, "position": 1.5}


def test_a_value_without_a_timestamp_has_no_age() -> None:
    ages = opcua.Ages()
    ages.of(stamps(power=0.0, position=None), now=0.0)
    assert ages.of(stamps(power=1.0, position=None), now=1.0)["position"] == math.inf


def test_a_clock_that_is_set_back_makes_no_value_fresh() -> None:
    ages = opcua.Ages()
    ages.of(stamps(power=0.0), now=0.0)
    ages.of(stamps(power=1.0), now=1.0)
    assert ages.of(stamps(power=-60.0), now=3.0)["power"] == 2.0
    assert ages.of(stamps(power=-59.0), now=4.0)["power"] == 0.0


def test_a_value_that_is_lost_is_no_reading() -> None:
    values = dict.fromkeys(["spindle_speed", "in_feed", "cutting", "edge"])
    readings = opcua.readings_of(values, seconds=0.05, edge_before=3)
    assert math.isnan(readings.spindle_speed)
    assert (readings.in_feed, readings.cutting, readings.new_edge) == (None, None, None)
    assert readings.engaged_time == 0.05


@pytest.mark.parametrize(("value", "switch"), [(1, True), (0.0, False), (2, None), ("on", None)])
def test_switches_are_true_or_false_or_lost(value: object, switch: bool | None) -> None:
    values = {"spindle_speed": "fast", "in_feed": value, "cutting": True}
    readings = opcua.readings_of(values, seconds=0.05, edge_before=None)
    assert readings.in_feed is switch
    assert math.isnan(readings.spindle_speed)


NEEDED_READINGS = "\n".join(["[readings]", *(f"{name} = 'i=1'" for name in opcua.NEEDED)])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        pytest.param("[readings]\nload = 'i=1'", "load", id="unknown reading"),
        pytest.param("[readings]\nspindle_speed = 'i=1'", "feed_velocity", id="missing reading"),
        pytest.param(f"{NEEDED_READINGS}\n[commands]\nfeed = 'i=2'", "feed", id="unknown command"),
        pytest.param(NEEDED_READINGS, "adaptive_feed", id="missing command"),
        pytest.param(f"{NEEDED_READINGS}\n[max_age]\npower = 1", "power", id="age of no reading"),
        pytest.param(
            f"{NEEDED_READINGS}\n[commands]\nadaptive_feed = 'i=2'\n[max_age]\ncutting = 0",
            "cutting",
            id="no age",
        ),
        pytest.param("readings = 5", "nodes.toml: 'readings' is 5, but must be a table", id="5"),
        pytest.param(f"{NEEDED_READINGS}\n[commands]\nadaptive_feed = 5", "a node id", id="id 5"),
        pytest.param("readings =", "nodes.toml is not TOML", id="no TOML"),
    ],
)
def test_a_file_of_nodes_that_does_not_fit_is_refused(
    text: str, named: str, tmp_path: Path
) -> None:
    path = tmp_path / "nodes.toml"
    path.write_text(text)
    with pytest.raises(ValueError, match=named):
        opcua.load_nodes(path)


def test_a_file_of_nodes_that_has_no_end_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "long.toml").write_bytes(b"#" * 1_000_001)
    for name in (tmp_path / "pipe.toml", tmp_path / "long.toml", Path("/dev/zero")):
        with pytest.raises(OSError, match=r"must be a regular file|is larger than 1000000 bytes"):
            opcua.load_nodes(name)


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
    day = datetime.timedelta(days=1)
    address = x509.UniformResourceIdentifier(f"urn:{name}")
    host = x509.DNSName(socket.gethostname())
    certificate = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - day)
        .not_valid_after(now + day)
        .add_extension(x509.SubjectAlternativeName([address, host]), critical=False)
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    plain = serialization.NoEncryption()
    certificate_path = folder / f"{name}.pem"
    certificate_path.write_bytes(certificate.public_bytes(pem))
    key_path = folder / f"{name}_key.pem"
    key_path.write_bytes(key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain))
    return certificate_path, key_path


class Guarded:
    """A server that lets in who is known, over protected connections only.

    Known are the user "turner" with a password, and clients with a certificate.
    """

    policies = (
        "Basic256Sha256_Sign",
        "Basic256Sha256_SignAndEncrypt",
        "Aes128Sha256RsaOaep_SignAndEncrypt",
    )

    def __init__(self, folder: Path) -> None:
        self.certificate, self.key = certified(folder, "server")
        self.client_certificate, self.client_key = certified(folder, "client")
        self.other_certificate, _ = certified(folder, "other")
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
                is_turner = (username, password) == ("turner", "secret")
                is_certified = username is None and certificate is not None
                return User(role=UserRole.User) if is_turner or is_certified else None

        server.load_certificate(str(self.certificate))
        server.load_private_key(str(self.key))
        server.set_security_policy([getattr(ua.SecurityPolicyType, name) for name in self.policies])
        server.set_identity_tokens([getattr(ua, name) for name in self.tokens])
        server.aio_obj.iserver.set_user_manager(Users())

    def security(self, **changed: Any) -> Security:
        """Return credentials that the server accepts, with some values changed."""
        accepted = Security(
            user="turner",
            password="secret",
            certificate=self.client_certificate,
            key=self.client_key,
            server_certificate=self.certificate,
        )
        return replace(accepted, **changed)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Guarded:
    """Return a guarded server and its clients, with certificates for all tests."""
    return Guarded(tmp_path_factory.mktemp("guarded"))


def drive(lathe: Lathe, security: Security) -> None:
    """Drive a server for three cycles."""
    cycles = iter([True, True, True, False])
    opcua.drive(
        Controller(scenario_of_a_control(), steady_policy()),
        lathe.url,
        nodes=lathe.plan,
        interval=INTERVAL,
        runs=lambda: next(cycles),
        security=security,
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_guarded_server_is_driven_with_user_and_certificate_only(
    guarded: Guarded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lacking = [
        Security(),
        Security(user="turner", password="secret"),
        guarded.security(user=None),
        guarded.security(policy="Aes256Sha256RsaPss"),
    ]
    with serving(tmp_path, guarded.protect) as lathe:
        drive(lathe, guarded.security())
        assert lathe.value("status") == Status.SAFE
        notice = capsys.readouterr().err
        assert "SignAndEncrypt" in notice
        assert "NOT" not in notice

        drive(lathe, guarded.security(server_certificate=None, mode="Sign"))
        notice = capsys.readouterr().err
        assert "NOT ENCRYPTED" in notice
        assert "NOT CHECKED" in notice

        for security in lacking:
            with pytest.raises(UserError, match="Basic256Sha256, mode SignAndEncrypt"):
                drive(lathe, security)
        with pytest.raises(UserError, match="needs --certificate and --key, needs --user"):
            drive(lathe, Security())
        with pytest.raises(OSError, match="another certificate"):
            drive(lathe, guarded.security(server_certificate=guarded.other_certificate))
        with pytest.raises(OSError, match=r"BadUserAccessDenied|BadIdentityToken"):
            drive(lathe, guarded.security(password="guess"))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_certificate_can_be_the_user(
    guarded: Guarded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guarded, "tokens", ["X509IdentityToken"])
    with serving(tmp_path, guarded.protect) as lathe:
        drive(lathe, guarded.security(user=None, password=None))
        assert lathe.value("status") == Status.SAFE


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_certificate_is_never_given_up_for_an_open_connection(
    lathe: Lathe, guarded: Guarded
) -> None:
    with_certificate = guarded.security(user=None, server_certificate=None)
    with pytest.raises(UserError, match="not protected"):
        drive(lathe, with_certificate)


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_password_goes_unencrypted_only_if_the_user_says_so(
    lathe: Lathe, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UserError, match="password unencrypted"):
        drive(lathe, Security(user="turner", password="secret"))
    drive(lathe, Security(user="turner", password="secret", policy="None"))
    assert "sent unencrypted" in capsys.readouterr().err


@pytest.mark.parametrize(
    "values",
    [
        pytest.param({"certificate": Path("client.pem")}, id="certificate without key"),
        pytest.param({"key": Path("client.pem")}, id="key without certificate"),
        pytest.param({"policy": "Basic256Sha256"}, id="policy without certificate"),
        pytest.param({"policy": "None", "mode": "Sign"}, id="signed without policy"),
        pytest.param(
            {"policy": "None", "server_certificate": Path("client.pem")},
            id="trust without policy",
        ),
    ],
)
def test_values_that_contradict_one_another_are_a_mistake(values: dict[str, Any]) -> None:
    with pytest.raises(UserError):
        Security(**values)


def test_without_a_password_or_a_terminal_a_user_is_a_mistake(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv(PASSWORD, raising=False)
    words = "drive --policy programmed --url opc.tcp://127.0.0.1:1 --nodes nodes.toml --user turner"
    assert main(words.split()) == 2


def test_a_password_is_not_shown() -> None:
    assert "secret" not in repr(Security(user="turner", password="secret"))
