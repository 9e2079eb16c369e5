"""Command-line options that protect a connection to a machine."""

import argparse
import os
from pathlib import Path

from turning_control.opcua_security import (
    KEY_PASSWORD,
    MODES,
    PASSWORD,
    POLICIES,
    Security,
    read_password,
)


def add_security(parser: argparse.ArgumentParser) -> None:
    """Add the options that protect a connection."""
    group = parser.add_argument_group(
        "security",
        "The program takes the safest connection that the server offers and these options allow.",
    )
    group.add_argument(
        "--user", metavar="NAME", help="user on the server (default: anonymous, or the certificate)"
    )
    group.add_argument(
        "--password-file",
        type=Path,
        metavar="FILE",
        help=f"file whose first line is the password; otherwise ${PASSWORD} or a prompt",
    )
    group.add_argument(
        "--certificate", type=Path, metavar="FILE", help="certificate of this program, PEM or DER"
    )
    group.add_argument(
        "--key",
        type=Path,
        metavar="FILE",
        help=f"its private key; ${KEY_PASSWORD} holds the key's password",
    )
    group.add_argument(
        "--server-certificate",
        type=Path,
        metavar="FILE",
        help="certificate of the server, the only one that is trusted",
    )
    group.add_argument(
        "--security-policy", choices=POLICIES, metavar="NAME", help=f"one of {', '.join(POLICIES)}"
    )
    group.add_argument(
        "--security-mode", choices=MODES, metavar="MODE", help=f"one of {', '.join(MODES)}"
    )


def security_of(options: argparse.Namespace) -> Security:
    """Return the credentials and settings that the options state.

    UserError if they contradict one another, or a password is missing.
    """
    return Security(
        user=options.user,
        password=read_password(options.user, options.password_file),
        certificate=options.certificate,
        key=options.key,
        key_password=os.environ.get(KEY_PASSWORD),
        server_certificate=options.server_certificate,
        policy=options.security_policy,
        mode=options.security_mode,
    )
