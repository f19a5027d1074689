"""Makes the emulated core skip instructions while it checks a wrong signature.

Two checks are attacked: that of the firmware, which verifies the signature twice, and for comparison that of embassy-boot,
which verifies it once.

This is a script for GDB. It reads from its environment:

PLANTAR_PROGRAM: the program `signature-check`
PLANTAR_EVERY: N, to attack every N-th instruction
PLANTAR_SKIPS: the file for the result, a JSON object with the numbers of attempts and of accepted images for each check

GDB reports every stop on its standard output, so messages are on the standard error.
"""

import json
import os
import re
import sys
import tempfile

import gdb

# Numbers of bytes that are skipped. An instruction has two or four.
SKIPS = range(2, 11, 2)
# The bytes in the bootloader's state that order it to swap the images.
MARK = b"\xf0" * 8


def report(message):
    print(message, file=sys.stderr, flush=True)


def address(symbol):
    return int(gdb.parse_and_eval(f"(long)&'{symbol}'")) & ~1


def program_counter():
    return int(gdb.parse_and_eval("(long)$pc"))


def proceed():
    """Runs to the next breakpoint, and returns its address."""
    gdb.execute("continue", to_string=True)
    return program_counter()


def proceed_from(at):
    """Continues at this address, to the next breakpoint."""
    gdb.execute(f"set $pc = {at:#x}")
    return proceed()


class Core:
    """The emulated core, controlled by GDB, and the addresses of the program that it runs."""

    def __init__(self, program, log):
        for setting in ["pagination off", "confirm off", "language c", "breakpoint always-inserted on"]:
            gdb.execute(f"set {setting}")
        gdb.execute(f"file {program}", to_string=True)
        # The emulator counts time in instructions (-icount). So the timeout with which the program ends an attempt that does
        # not return from the check does not depend on the speed of this computer.
        emulator = "qemu-system-arm -M netduinoplus2 -display none -monitor none -serial none -icount shift=0"
        self.emulator = f"{emulator} -kernel {program} -d in_asm -D {log} -S -gdb stdio"
        self.start()
        self.check = address("signature_check::check")
        self.end = address("signature_check::end")
        self.mark = address("signature_check::MARK")
        self.verifies_once = address("signature_check::VERIFIES_ONCE")
        for at in [self.check, self.end, address("HardFault")]:
            gdb.execute(f"hbreak *{at:#x}", to_string=True)

    def start(self):
        gdb.execute(f"target remote | {self.emulator}", to_string=True)

    def begin(self, verifies_once):
        """Runs to the beginning of the next check."""
        try:
            # A skip can leave the stack pointer outside of the RAM, where the next access ends the emulator.
            gdb.execute("set $sp = *(unsigned long *)0x08000000")
            if program_counter() != self.end:
                # GDB stops there at once, because there is a breakpoint.
                proceed_from(self.end)
            at = proceed()
        except gdb.error:
            # The emulator ends when a fault occurs in the handler of a fault.
            at = None
        if at != self.check:
            # A skip can also have changed memory that the program needs.
            self.start()
            at = proceed()
        if at != self.check:
            raise SystemExit(f"the program stopped at {program_counter():#x} instead of the check")
        gdb.selected_inferior().write_memory(self.verifies_once, bytes([verifies_once]))

    def is_accepted(self):
        """Returns whether the image is marked for the bootloader."""
        return bytes(gdb.selected_inferior().read_memory(self.mark, len(MARK))) == MARK

    def attempt(self, verifies_once, at, skip):
        """Skips bytes at this address; returns whether the image was accepted, or None if the check never gets there."""
        self.begin(verifies_once)
        if at != self.check:
            # GDB would move a breakpoint of its own out of an IT block (conditional instructions).
            gdb.execute(f"maintenance packet Z1,{at:x},2", to_string=True)
            stop = proceed()
            gdb.execute(f"maintenance packet z1,{at:x},2", to_string=True)
            if stop != at:
                return None
        proceed_from(at + skip)
        return self.is_accepted()


def instructions(log):
    """The addresses of all instructions in QEMU's log of translated code."""
    with open(log) as lines:
        return sorted({int(found[1], 16) for line in lines if (found := re.match(r"(0x[0-9a-f]{8}):\s+[0-9a-f]{4}", line))})


def check(core, verifies_once):
    """Checks the wrong signature without an attack."""
    core.begin(verifies_once)
    proceed()
    if core.is_accepted():
        raise SystemExit("the wrong signature is accepted without any attack")


def attack(core, addresses, name, verifies_once):
    """Skips bytes at each of these addresses; returns the numbers of attempts and of accepted images."""
    attempts, accepted = 0, 0
    for number, at in enumerate(addresses):
        for skip in SKIPS:
            outcome = core.attempt(verifies_once, at, skip)
            if outcome is None:
                break
            attempts += 1
            if outcome:
                accepted += 1
                report(f"{name}: accepted after {skip} bytes were skipped at {at:#x}")
        if number % 500 == 0:
            report(f"{name}: {number} of {len(addresses)} instructions")
    report(f"{name}: {attempts} skips, {accepted} images accepted")
    return {"attempts": attempts, "accepted": accepted}


def main():
    every = int(os.environ["PLANTAR_EVERY"])
    with tempfile.NamedTemporaryFile() as log:
        core = Core(os.environ["PLANTAR_PROGRAM"], log.name)
        checks = {"one check": True, "both checks": False}
        for verifies_once in checks.values():
            check(core, verifies_once)
        # An attack makes the core execute data too, so only the instructions that ran before the first attack count.
        addresses = instructions(log.name)[::every]
        results = {name: attack(core, addresses, name, verifies_once) for name, verifies_once in checks.items()}
        gdb.execute("kill", to_string=True)
    with open(os.environ["PLANTAR_SKIPS"], "w") as file:
        json.dump(results, file)


main()
