"""Confine this process to what a network's arithmetic needs, before a stranger's file is read.

Three measures follow one another, and each holds without the others:

* **limits** of the operating system: memory, processor time, no new descriptors, no writing to
  files, no new processes;
* **Landlock** (Linux 5.13): no file is opened, created, removed or renamed, and, on newer kernels,
  no connection is made and no signal sent to another process;
* **seccomp** (Linux 3.17): every system call that is not on a short list fails with EPERM, whatever
  the process has become.

Nothing gives a right back. ``docs/soundness.md`` says what remains where a measure is missing. The
file is imported by the process that it confines, and imports nothing of the package. No maintained
library has all three: that for Landlock has neither connections nor signals, and that for seccomp
needs a shared library of the system.

Sources: the kernel's ``Documentation/userspace-api/landlock.rst`` and ``seccomp_filter.rst``; the
numbers of system calls in ``arch/x86/entry/syscalls/syscall_64.tbl`` and
``include/uapi/asm-generic/unistd.h``.
"""

import ctypes
import os
import platform
import struct
import sys

try:
    import resource
except ImportError:  # pragma: no cover - on Windows
    resource = None  # type: ignore[assignment]

LIMITS = "limits"
LANDLOCK = "Landlock"
SECCOMP = "seccomp"
MEASURES = (LIMITS, LANDLOCK, SECCOMP)

_NUM_DESCRIPTORS = 3  # standard input, output and error; the first is the connection to the parent
_MAX_DESCRIPTORS = 2**20  # no system has more by default


def limit(memory: int, computing: int) -> tuple[str, ...]:
    """Confine this process to limits of memory and time, and to no files or processes.

    Import all that is needed before.

    Args:
        memory: [MiB].
        computing: processor time [s]; 0: any.

    Returns:
        the ``MEASURES`` that the operating system took.
    """
    privileges_renounced = sys.platform == "linux" and _renounce_privileges()
    # In this order: Landlock needs a descriptor, limits need system calls, the filter forbids both.
    measures = {
        LANDLOCK: privileges_renounced and _forbid_files(),
        LIMITS: _limit_resources(memory, computing),
        SECCOMP: privileges_renounced and _forbid_system_calls(),
    }
    return tuple(name for name in MEASURES if measures[name])


def _limit_resources(memory: int, computing: int) -> bool:
    """Set the operating system's limits; return whether it took all of them."""
    if resource is None:  # on Windows the parent limits the time alone
        return False
    # Whatever else the parent may have left open.
    os.closerange(_NUM_DESCRIPTORS, _highest_descriptor() + 1)
    limits = {
        resource.RLIMIT_AS: (memory * 2**20, memory * 2**20),
        resource.RLIMIT_CORE: (0, 0),
        resource.RLIMIT_FSIZE: (0, 0),
        # A descriptor's number must be below it, so that none is free, also after one is closed.
        resource.RLIMIT_NOFILE: (0, 0),
        resource.RLIMIT_NPROC: (0, 0),
    }
    if computing:
        # The soft limit ends the process with a signal that says why.
        limits[resource.RLIMIT_CPU] = (computing, computing + 5)
    all_set = True
    for kind, (soft, hard) in limits.items():
        # A lower limit that the parent has cannot be raised, and need not be.
        _, allowed = resource.getrlimit(kind)
        highest = hard if allowed == resource.RLIM_INFINITY else min(hard, allowed)
        try:
            resource.setrlimit(kind, (min(soft, highest), highest))
        except (ValueError, OSError):  # macOS has no limit of memory
            all_set = False
    return all_set


def _highest_descriptor() -> int:
    soft_limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft_limit == resource.RLIM_INFINITY:
        return _MAX_DESCRIPTORS
    return min(soft_limit, _MAX_DESCRIPTORS)


# --------------------------------------------------------------------------------------------------
# Linux

_PR_SET_NO_NEW_PRIVS = 38

# Landlock's system calls have the same numbers on all processors.
_LANDLOCK_CREATE_RULESET = 444
_LANDLOCK_RESTRICT_SELF = 446
_LANDLOCK_CREATE_RULESET_VERSION = 1
# Number of rights to files that are known from a version of the interface on.
_FILE_RIGHTS = {1: 13, 2: 14, 3: 15, 5: 16}
_NETWORK_VERSION = 4
_NETWORK_RIGHTS = 0b11  # bind and connect TCP
_SCOPE_VERSION = 6
_SCOPES = 0b11  # connect to abstract Unix sockets, and send signals, outside

_SECCOMP_SET_MODE_FILTER = 1
_SECCOMP_FILTER_FLAG_TSYNC = 1  # for all threads of the process
_SECCOMP_RET_KILL_PROCESS = 0x80000000
_SECCOMP_RET_ERRNO = 0x00050000
_SECCOMP_RET_ALLOW = 0x7FFF0000
_EPERM = 1

_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}  # AUDIT_ARCH_...
_SECCOMP = {"x86_64": 317, "aarch64": 277}

# The calls that a network's arithmetic, Python and the messages to the parent need: memory, time,
# locks, random numbers, the end, and the three open descriptors. None of these opens anything or
# reaches another process.
_ALLOWED = {
    "x86_64": {
        "read": 0,
        "write": 1,
        "close": 3,
        "fstat": 5,
        "lseek": 8,
        "mmap": 9,
        "mprotect": 10,
        "munmap": 11,
        "brk": 12,
        "rt_sigaction": 13,
        "rt_sigprocmask": 14,
        "rt_sigreturn": 15,
        "sched_yield": 24,
        "mremap": 25,
        "madvise": 28,
        "getpid": 39,
        "sendto": 44,
        "recvfrom": 45,
        "exit": 60,
        "gettimeofday": 96,
        "sysinfo": 99,
        "getppid": 110,
        "sigaltstack": 131,
        "gettid": 186,
        "futex": 202,
        "sched_getaffinity": 204,
        "restart_syscall": 219,
        "clock_gettime": 228,
        "clock_nanosleep": 230,
        "exit_group": 231,
        "getcpu": 309,
        "getrandom": 318,
    },
    "aarch64": {
        "close": 57,
        "lseek": 62,
        "read": 63,
        "write": 64,
        "fstat": 80,
        "exit": 93,
        "exit_group": 94,
        "futex": 98,
        "clock_gettime": 113,
        "clock_nanosleep": 115,
        "sched_getaffinity": 123,
        "sched_yield": 124,
        "restart_syscall": 128,
        "sigaltstack": 132,
        "rt_sigaction": 134,
        "rt_sigprocmask": 135,
        "rt_sigreturn": 139,
        "getcpu": 168,
        "gettimeofday": 169,
        "getpid": 172,
        "getppid": 173,
        "gettid": 178,
        "sysinfo": 179,
        "sendto": 206,
        "recvfrom": 207,
        "brk": 214,
        "munmap": 215,
        "mremap": 216,
        "mmap": 222,
        "mprotect": 226,
        "madvise": 233,
        "getrandom": 278,
    },
}

# Instructions of the filter, a program for the classic Berkeley packet filter.
_LOAD_WORD = 0x20  # BPF_LD | BPF_W | BPF_ABS
_JUMP_IF_EQUAL = 0x15  # BPF_JMP | BPF_JEQ | BPF_K
_RETURN = 0x06  # BPF_RET | BPF_K
_NUMBER, _ARCHITECTURE = 0, 4  # places of both in struct seccomp_data


def _system_call(number: int, *arguments: object) -> int:
    """Call the kernel. Return its result, or -1 if it refuses or does not know the call."""
    libc = ctypes.CDLL(None)
    libc.syscall.restype = ctypes.c_long
    return int(libc.syscall(ctypes.c_long(number), *arguments))


def _renounce_privileges() -> bool:
    """Promise never to gain privileges; else the kernel takes no rules of an ordinary user."""
    zero = ctypes.c_ulong(0)
    refused = ctypes.CDLL(None).prctl(_PR_SET_NO_NEW_PRIVS, ctypes.c_ulong(1), zero, zero, zero)
    return not refused


def _forbid_files() -> bool:
    """Let Landlock forbid all that it can, with no exception. Return whether it does."""
    null = ctypes.c_void_p(None)
    version = _system_call(
        _LANDLOCK_CREATE_RULESET,
        null,
        ctypes.c_size_t(0),
        ctypes.c_uint32(_LANDLOCK_CREATE_RULESET_VERSION),
    )
    if version < 1:
        return False
    file_rights = max(count for since, count in _FILE_RIGHTS.items() if since <= version)
    network_rights = _NETWORK_RIGHTS if version >= _NETWORK_VERSION else 0
    scopes = _SCOPES if version >= _SCOPE_VERSION else 0
    # struct landlock_ruleset_attr; a kernel that knows only the first fields takes the others if
    # they are 0.
    attributes = struct.pack("=QQQ", 2**file_rights - 1, network_rights, scopes)
    size = ctypes.c_size_t(len(attributes))
    rules = _system_call(
        _LANDLOCK_CREATE_RULESET, ctypes.c_char_p(attributes), size, ctypes.c_uint32(0)
    )
    if rules < 0:
        return False
    forbidden = _system_call(_LANDLOCK_RESTRICT_SELF, ctypes.c_int(rules), ctypes.c_uint32(0)) == 0
    os.close(rules)
    return forbidden


def _forbid_system_calls() -> bool:
    """Install the filter of system calls in all threads. Return whether the kernel took it."""
    machine = platform.machine()
    if machine not in _ALLOWED or sys.maxsize < 2**32:
        return False
    program = _filter(_ARCHITECTURES[machine], sorted(_ALLOWED[machine].values()))
    instructions = ctypes.create_string_buffer(program, len(program))

    class Program(ctypes.Structure):
        """``struct sock_fprog`` of the kernel."""

        _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_void_p))

    filled = Program(len(program) // 8, ctypes.addressof(instructions))
    mode = ctypes.c_uint(_SECCOMP_SET_MODE_FILTER)
    flags = ctypes.c_uint(_SECCOMP_FILTER_FLAG_TSYNC)
    return _system_call(_SECCOMP[machine], mode, flags, ctypes.byref(filled)) == 0


def _filter(architecture: int, allowed: list[int]) -> bytes:
    """Return the filter of system calls.

    Another architecture's calls end the process; calls that are not allowed fail with EPERM.
    """
    count = len(allowed)
    instructions = [
        _instruction(_LOAD_WORD, _ARCHITECTURE),
        _instruction(_JUMP_IF_EQUAL, architecture, if_true=1),
        _instruction(_RETURN, _SECCOMP_RET_KILL_PROCESS),
        _instruction(_LOAD_WORD, _NUMBER),
    ]
    for place, number in enumerate(allowed):
        # Jump over the comparisons that are left, and over the refusal.
        instructions.append(_instruction(_JUMP_IF_EQUAL, number, if_true=count - place))
    instructions.append(_instruction(_RETURN, _SECCOMP_RET_ERRNO | _EPERM))
    instructions.append(_instruction(_RETURN, _SECCOMP_RET_ALLOW))
    return b"".join(instructions)


def _instruction(code: int, value: int, if_true: int = 0) -> bytes:
    """Return an instruction, ``struct sock_filter``.

    A jump skips ``if_true`` instructions if its condition holds.
    """
    return struct.pack("=HBBI", code, if_true, 0, value)
