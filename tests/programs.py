"""Programs beside Python that some tests need, and why a test is left out without them."""

NO_CHROMIUM = "Chromium is not installed; install it with: make system"
NO_LINUXCNC = "LinuxCNC is not installed; install it with: make system"
LINUXCNC_ALONE = "one LinuxCNC runs on a machine at a time; run these tests with: make control"
