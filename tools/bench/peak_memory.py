"""Runs a command and prints its largest resident memory: on Linux in MiB, because ru_maxrss is in KiB there.

The arguments are a folder, which is not used, and the command with its arguments.
"""

import resource
import subprocess
import sys

subprocess.run(sys.argv[2:], stdout=subprocess.DEVNULL, check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)
