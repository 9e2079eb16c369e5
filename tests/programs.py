"""Reasons for which tests are left out: programs beside Python that are not installed."""

NO_CHROMIUM = "Chromium is not installed; install it with: make system"
NO_LINUXCNC = "LinuxCNC is not installed; install it with: make system"
LINUXCNC_ALONE = "one LinuxCNC runs on a machine at a time; run these tests with: make control"
