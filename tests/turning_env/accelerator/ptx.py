"""The kernels as NVIDIA's compiler leaves them (PTX), played on the processor.

PTX is translated to C, one statement for each instruction, with the meanings of NVIDIA's "Parallel Thread Execution ISA"; threads
run one after the other. What it shows: that the compiled instructions are those of the transition, rounding for rounding. What it
cannot show: that a GPU does what the manual says of them. An instruction that is not in the table is an error.
"""

import ctypes
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import types
from numba.np import numpy_support

from turning_env.accelerator.target import THREADS, cuda, refuse_fused, unfused

CAPABILITY = (9, 0)

_C_TYPES = {
    "f64": "double",
    "f32": "float",
    **{f"{sign}{bits}": f"{'' if sign == 's' else 'u'}int{bits}_t" for sign in "usb" for bits in (8, 16, 32, 64)},
}
_REGISTERS = {"p": "int", "rs": "uint16_t", "r": "uint32_t", "rd": "uint64_t", "f": "float", "fd": "double"}
_ORDERED = {"eq": "==", "lt": "<", "le": "<=", "gt": ">", "ge": ">="}
_UNORDERED = {"neu": "==", "ltu": ">=", "leu": ">", "gtu": "<=", "geu": "<"}  # true unless this holds
_OPERATIONS = {
    **{f"{name}.rn.f64": f"$0 = $1 {sign} $2" for name, sign in (("add", "+"), ("sub", "-"), ("mul", "*"), ("div", "/"))},
    **{f"{name}.{sign}64": f"$0 = $1 {sign_c} $2" for name, sign_c in (("add", "+"), ("sub", "-")) for sign in "us"},
    **{
        f"{name}.{kind}": f"$0 = $1 {c} $2"
        for name, c in (("and", "&"), ("or", "|"), ("xor", "^"))
        for kind in ("b16", "b32", "b64", "pred")
    },
    **{f"selp.{kind}": "$0 = $3 ? $1 : $2" for kind in _C_TYPES},
    **{f"mov.{kind}": "$0 = $1" for kind in _C_TYPES if kind != "b64"},
    **{
        f"setp.{name}.{kind}": f"$0 = ({c})$1 {sign} ({c})$2"
        for name, sign in (*_ORDERED.items(), ("ne", "!="))
        for kind, c in _C_TYPES.items()
        if kind[0] != "f" or name != "ne"
    },
    **{f"setp.{name}.f64": f"$0 = !($1 {sign} $2)" for name, sign in _UNORDERED.items()},
    "add.s32": "$0 = $1 + $2",
    "mul.lo.s64": "$0 = $1 * $2",
    "mul.wide.s32": "$0 = (int64_t)(int32_t)$1 * (int64_t)(int32_t)$2",
    "rcp.rn.f64": "$0 = 1.0 / $1",
    "sqrt.rn.f64": "$0 = sqrt($1)",
    "neg.f64": "$0 = -$1",
    "neg.s64": "$0 = 0 - $1",
    "not.b64": "$0 = ~$1",
    "abs.f64": "$0 = fabs($1)",
    "abs.f32": "$0 = fabsf($1)",
    "min.f64": "$0 = lesser($1, $2)",
    "max.f64": "$0 = greater($1, $2)",
    "min.s64": "$0 = (int64_t)$1 < (int64_t)$2 ? $1 : $2",
    "max.s64": "$0 = (int64_t)$1 > (int64_t)$2 ? $1 : $2",
    "shl.b64": "$0 = $1 << $2",
    "shr.u64": "$0 = $1 >> $2",
    "shr.s64": "$0 = (int64_t)$1 >> $2",
    "cvt.rmi.f64.f64": "$0 = floor($1)",
    "cvt.rni.f64.f64": "$0 = nearbyint($1)",
    "cvt.rn.f64.s64": "$0 = (double)(int64_t)$1",
    "cvt.rn.f64.u64": "$0 = (double)$1",
    "cvt.rzi.u64.f64": "$0 = whole($1)",
    "cvt.rzi.s64.f64": "$0 = (int64_t)$1",
    "cvt.rn.f32.f64": "$0 = (float)$1",
    "cvt.f64.f32": "$0 = (double)$1",
    "cvt.s64.s32": "$0 = (int64_t)(int32_t)$1",
    "cvt.u64.u32": "$0 = $1",
    "cvta.to.global.u64": "$0 = $1",
    "atom.global.min.s64": "$0 = at(int64_t, $1); at(int64_t, $1) = (int64_t)$2 < (int64_t)$0 ? $2 : $0",
    "bra": "goto $0",
    "bra.uni": "goto $0",
    "ret": "return",
}
_PREAMBLE = """
#include <math.h>
#include <stdint.h>
#include <string.h>
#define at(type, address) (*(type *)(address))
static double as_double(uint64_t bits) { union { uint64_t bits; double number; } u = {bits}; return u.number; }
static uint64_t as_bits(double number) { union { double number; uint64_t bits; } u = {number}; return u.bits; }
static double lesser(double a, double b) {  // -0 is less than 0, and a number is taken rather than none
  return isnan(a) ? b : isnan(b) ? a : a == b ? (signbit(a) ? a : b) : a < b ? a : b;
}
static double greater(double a, double b) {
  return isnan(a) ? b : isnan(b) ? a : a == b ? (signbit(a) ? b : a) : a > b ? a : b;
}
static uint64_t whole(double x) { return x > 0.0 ? (uint64_t)x : 0; }
"""


def translated(code: str, name: str) -> str:
    """A kernel's PTX as a C function of the thread's place and the parameters, and one that tells how many these are."""
    body = re.sub(r"//.*", "", code[code.index("\n{") + 2 : code.rindex("}")])
    lines = [line.strip().rstrip(";") for line in body.splitlines()]
    statements = [_statement(line) for line in lines if line and not line.startswith(".pragma")]
    count = len(re.findall(r"^\s*\.param", code, re.MULTILINE))
    signature = f"void {name}(uint32_t thread, uint32_t threads, uint32_t block, const uint64_t *parameters)"
    return "\n".join([signature, "{", *statements, "}", f"int {name}_parameters(void) {{ return {count}; }}", ""])


def _statement(line: str) -> str:
    if line.startswith(".local"):
        size = re.findall(r"\[(\d+)\]", line)[0]
        return f"_Alignas(16) unsigned char depot[{size}]; memset(depot, 0x7F, {size});"  # what nobody should rely on
    if line.startswith(".reg"):
        name, count = re.findall(r"%(\w+)(?:<(\d+)>)?", line)[0]
        if not count:
            return f"uint64_t {name} = 0;"
        return f"{_REGISTERS[name]} {', '.join(f'{name}{place} = 0' for place in range(int(count)))};"
    if line.endswith(":"):
        return line.replace("$", "label") + ";"
    condition, operation, rest = re.fullmatch(r"(?:@(!?%p\d+)\s+)?(\S+)\s*(.*)", line).groups()  # type: ignore[union-attr]
    operands = [operand.strip() for operand in re.findall(r"\s*\{[^}]*\}|\s*\[[^]]*\]|[^,]+", rest)]
    prefix = f"if ({condition.replace('%', '')}) " if condition else ""
    return prefix + "{ " + _action(operation, operands) + "; }"


def _action(operation: str, operands: list[str]) -> str:
    kind, *words = operation.split(".")
    if kind in ("ld", "st"):
        place, value = (operands[1], operands[0]) if kind == "ld" else operands
        if "param" in words:
            return f"{_value(value)} = {_value(place[1:-1])}"
        base, offset = re.fullmatch(r"\[(%\w+)\+?(-?\d+)?\]", place).groups()  # type: ignore[union-attr]
        c, size = _C_TYPES[words[-1]], int(words[-1][1:]) // 8
        pairs = [
            (f"at({c}, {_value(base)} + {int(offset or 0) + size * k})", _value(one.strip()))
            for k, one in enumerate(value.strip("{}").split(","))
        ]
        return "; ".join(f"{inner} = {memory}" if kind == "ld" else f"{memory} = {inner}" for memory, inner in pairs)
    if operation == "mov.b64":
        target, source = operands
        cast = {(True, False): "as_double", (False, True): "as_bits"}.get((target[:3] == "%fd", source[:3] == "%fd"), "")
        return f"{_value(target)} = {cast}({_value(source)})"
    if operation not in _OPERATIONS:
        raise ValueError(f"the instruction {operation} has no translation")
    return re.sub(r"\$(\d)", lambda place: _value(operands[int(place[1])]), _OPERATIONS[operation])


def _value(operand: str) -> str:
    special = {"%tid.x": "thread", "%ntid.x": "threads", "%ctaid.x": "block", "__local_depot0": "(uint64_t)depot"}
    operand = operand.strip("[]")
    if operand in special:
        return special[operand]
    if operand.startswith(("%", "$")):
        return operand.replace("%", "").replace("$", "label")
    if operand.startswith("0d"):
        return f"as_double(0x{operand[2:]}ull)"
    if operand.startswith("0f"):
        return f"(float)as_double(0x{np.float64(np.uint32(int(operand[2:], 16)).view(np.float32)).view(np.uint64):x}ull)"
    if "_param_" in operand:
        return f"parameters[{operand.rsplit('_', 1)[1]}]"
    return "INT64_MIN" if operand == str(-(2**63)) else f"{int(operand)}ll"


def signatures(kernels: Any) -> dict[str, Any]:
    """Of the kernels, by name, with actions of float32."""

    def array(kind: Any, dimensions: int, layout: str = "C") -> Any:
        return types.Array(numpy_support.from_dtype(np.dtype(kind)), dimensions, layout)

    records = array(kernels.LANE, 2, "A"), array(kernels.ALIGNED_PARAMETERS, 1), array(kernels.LANE_REPORT, 2, "A")
    answers = array(np.float32, 2), array(np.float64, 1), array(np.bool_, 2)
    return {
        "start": types.void(*records, array(np.uint64, 1), *answers),
        "step": types.void(*records, array(np.float32, 2), *answers, array(np.int64, 1)),
        "tell": types.void(*records, array(np.float64, 1)),
    }


def compiled_to_ptx(kernels: Any, monkeypatch: Any, capability: tuple[int, int] = CAPABILITY) -> dict[str, str]:
    """The kernels' PTX by name, for a GPU of a compute capability that need not be there."""
    from numba.cuda import dispatcher

    device = SimpleNamespace(compute_capability=capability)
    monkeypatch.setattr(dispatcher, "get_current_device", lambda: device)
    codes = {}
    for name, signature in signatures(kernels).items():
        with unfused():
            codes[name], _ = cuda.compile_ptx(getattr(kernels, f"_{name}"), signature, cc=capability)
        refuse_fused(codes[name])
    return codes


class Memory(np.ndarray):
    """Main memory that stands for a GPU's."""

    __cuda_ndarray__ = True

    def __new__(cls, array: Any) -> "Memory":
        return np.asarray(array).view(cls)

    def copy_to_host(self) -> Any:
        return np.array(self)

    def copy_to_device(self, array: Any) -> None:
        self[...] = array


MEMORY = SimpleNamespace(
    to_device=lambda array: Memory(np.array(array)), device_array=lambda shape, kind: Memory(np.full(shape, 77, kind))
)
"""What ``AcceleratedLathes`` asks of Numba."""


class Played:
    """A translated kernel, in place of ``Kernel``."""

    def __init__(self, library: ctypes.CDLL, name: str) -> None:
        self._function = library[name]
        self._count = library[f"{name}_parameters"]()

    def __call__(self, lanes: int, *arrays: Any) -> None:
        numbers: list[int] = []
        for array in arrays:  # as Numba passes them: two pointers to owners, sizes, data, shape and strides
            data = array.__array_interface__["data"][0]
            numbers += [0, 0, array.size, array.dtype.itemsize, data, *array.shape, *array.strides]
        assert len(numbers) == self._count
        parameters = (ctypes.c_uint64 * len(numbers))(*numbers)
        for lane in range(-(-lanes // THREADS) * THREADS):
            block, thread = divmod(lane, THREADS)
            self._function(thread, THREADS, block, parameters)


def played_on_processor(codes: dict[str, str], folder: Path) -> dict[str, Played]:
    """The kernels by name, translated and compiled in a folder."""
    source, library = folder / "kernels.c", folder / "kernels.so"
    source.write_text(_PREAMBLE + "".join(translated(code, name) for name, code in codes.items()), "utf-8")
    exact = ["-O1", "-w", "-ffp-contract=off", "-fno-strict-aliasing", "-fwrapv"]
    subprocess.run(["cc", *exact, "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
    loaded = ctypes.CDLL(str(library))
    return {name: Played(loaded, name) for name in codes}
