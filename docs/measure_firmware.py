"""Count the clocks that a sample of the firmware takes on a Cortex-M4: `python docs/measure_firmware.py [SPEC ...]`.

The firmware of each pad is compiled (clang, -O2), and a transition from silence to all taxels is run instruction by
instruction in an emulator. Each instruction counts as in Arm's Cortex-M4 Technical Reference Manual (DDI 0439, tables
3-1 and 7-1), the longer where it tells two; memory answers at once. A processor without floating-point unit is counted
with `--soft`, at the same clocks an instruction. Needs `pip install capstone unicorn ziglang`.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import capstone
import unicorn
from unicorn import arm_const as arm

import padgen as pg
from padgen.driver.formats.c import FILE, c_header, firmware_files, sample_mhz
from padgen.driver.waveform import CONTROLLER_RATES_HZ, drive_at

SPECS = ("paper-16", "paper-32", "pad-32", "resin-fine", "quad-64", "triple-48", "wide-11", "big-512")
MAIN = """
#include "padgen_drive.h"
#include <string.h>
static padgen_drive drive;
static uint8_t level[PADGEN_TAXELS];
static float volts[PADGEN_COILS];
void begin(void) { padgen_start(&drive); drive.rest = 0; memset(level, 200, sizeof level); padgen_show(&drive, level); }
void sample(void) { padgen_next(&drive, volts); }
void _start(void) { begin(); sample(); }
"""
STAND_INS = {
    "math.h": "#define sqrtf __builtin_sqrtf\n",
    "string.h": "#include <stddef.h>\nvoid *memcpy(void *, const void *, size_t), *memset(void *, int, size_t);\n",
}
SAMPLES = 12
RAM = 0x20000000
STACK = 0x200F0000
END = 0x1F00000
ENABLE_FPU = 0xE000ED88
TAKEN = 3
"""Clocks that a branch takes more when it is taken, at most."""


def compiled(folder: Path, soft: bool) -> Path:
    """Compile the firmware in a folder as a program without an operating system."""
    for name, text in {"main.c": MAIN, **STAND_INS}.items():
        (folder / name).write_text(text)
    cpu, abi = ("cortex_m0plus", "eabi") if soft else ("cortex_m4+vfp4d16sp", "eabihf")
    command = [sys.executable, "-m", "ziglang", "cc", "-target", f"thumb-freestanding-{abi}", f"-mcpu={cpu}", "-O2"]
    options: list[str | Path] = [
        "-std=c99",
        "-fno-math-errno",
        "-static",
        "-g0",
        "-I",
        folder,
        "-o",
        folder / "program",
    ]
    subprocess.run([*command, *options, folder / "main.c", folder / "padgen_drive.c"], check=True)
    return folder / "program"


def clocks(instruction: capstone.CsInsn) -> int:
    """Return the clocks of an instruction; a conditional branch as if it were not taken."""
    name = instruction.mnemonic.split(".")[0]
    operands = instruction.op_str
    if name.startswith(("vdiv", "vsqrt")):
        return 14
    if name.startswith(("vmla", "vmls", "vnml", "vfm", "vfnm")):
        return 3
    if name.startswith(("vadd", "vsub", "vmul", "vnmul", "vcvt", "vneg", "vabs")):
        return 2  # its result is waited for
    if name.startswith(("vpush", "vpop", "vldm", "vstm", "ldm", "stm", "push", "pop")):
        return 1 + len(instruction.operands) + TAKEN * ("pc" in operands)
    if name.startswith(("ldr", "str", "vldr", "vstr")):
        return 2 + (name.endswith("rd") or operands.startswith("d")) + TAKEN * operands.startswith("pc")
    if name.startswith(("udiv", "sdiv")):
        return 12
    if name in ("b", "bl", "bx", "blx", "tbb", "tbh"):
        return 2 + TAKEN
    return 2 if name in ("mla", "mls", "umlal", "smlal") else 1


class Machine:
    """A program in an emulated processor."""

    def __init__(self, program: Path, soft: bool) -> None:
        self.cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self.cpu.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M0 if soft else arm.UC_CPU_ARM_CORTEX_M4)
        for start, size in ((0, 1 << 25), (RAM, 1 << 20), (ENABLE_FPU & ~0xFFF, 1 << 12)):
            self.cpu.mem_map(start, size)
        self.cpu.mem_write(ENABLE_FPU, (0xF << 20).to_bytes(4, "little"))
        data = program.read_bytes()

        def number(at: int, size: int = 4) -> int:
            return int.from_bytes(data[at : at + size], "little")

        for head in (number(28) + number(42, 2) * k for k in range(number(44, 2))):
            if number(head) == 1:  # a part that is loaded
                self.cpu.mem_write(number(head + 8), data[number(head + 4) :][: number(head + 16)])
        self.symbols = {}
        tables = [number(32) + number(46, 2) * k for k in range(number(48, 2))]
        for table in (head for head in tables if number(head + 4) == 2):
            names = number(tables[number(table + 24)] + 16)
            for at in range(number(table + 16), number(table + 16) + number(table + 20), 16):
                name = data[names + number(at) : data.index(b"\0", names + number(at))].decode()
                self.symbols[name] = number(at + 4)
        self.reader = capstone.Cs(capstone.CS_ARCH_ARM, capstone.CS_MODE_THUMB | capstone.CS_MODE_MCLASS)
        self.reader.detail = True
        self.known: dict[int, tuple[int, bool]] = {}
        self.count = 0
        self.next = 0
        self.branches = False
        self.cpu.hook_add(unicorn.UC_HOOK_CODE, self.step)

    def step(self, cpu: unicorn.Uc, at: int, size: int, _: object) -> None:
        """Count an instruction, and a conditional branch before it that was taken."""
        if at not in self.known:
            one = next(self.reader.disasm(bytes(cpu.mem_read(at, size)), at))
            may = one.group(capstone.CS_GRP_JUMP) and one.mnemonic.split(".")[0] not in ("b", "bl", "bx", "blx")
            self.known[at] = clocks(one), may
        self.count += TAKEN * (self.branches and at != self.next)
        cost, self.branches = self.known[at]
        self.count = self.count + cost
        self.next = at + size

    def call(self, name: str) -> int:
        """Run a function and return its clocks."""
        self.count = 0
        self.branches = False
        self.cpu.reg_write(arm.UC_ARM_REG_SP, STACK)
        self.cpu.reg_write(arm.UC_ARM_REG_LR, END | 1)
        self.cpu.emu_start(self.symbols[name] | 1, END)
        return self.count


def main(specs: list[str], soft: bool) -> None:
    """Print a line for each spec: clocks of the longest sample, at most by padgen's bound, and both as a frequency."""
    for spec in specs:
        plan = pg.plan(spec)
        drive = drive_at(plan, CONTROLLER_RATES_HZ)
        with TemporaryDirectory() as folder:
            for name, data in {**firmware_files(), FILE: c_header(plan, drive).encode()}.items():
                Path(folder, name).write_bytes(data)
            machine = Machine(compiled(Path(folder), soft), soft)
            machine.call("begin")
            most = max(machine.call("sample") for _ in range(SAMPLES))
        bound = round(sample_mhz(drive) / drive.rate_hz * 1e6)
        print(
            f"{spec} ({drive.scheme.name}, {len(drive.coils)} coils, {len(plan.taxels)} taxels): {most} clocks, bound",
            end="",
        )
        print(f" {bound}; {most * drive.rate_hz / 1e6:.1f} MHz at {drive.rate_hz} samples/s", flush=True)


if __name__ == "__main__":
    soft = "--soft" in sys.argv
    main([name for name in sys.argv[1:] if name != "--soft"] or list(SPECS), soft)
