"""Runs a command and prints its largest resident memory, MB.

The arguments are a folder, which src/python.rs passes to every script and which is not used here, and the command with its
arguments.
"""

import resource
import subprocess
import sys

subprocess.run(sys.argv[2:], stdout=subprocess.DEVNULL, check=True)
# ru_maxrss is in bytes on macOS and in KiB elsewhere.
unit = 1 if sys.platform == "darwin" else 1024
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * unit / 1e6)
