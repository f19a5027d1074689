"""Runs a command and prints its largest memory (MB).

The arguments are a folder, which is not used, and the command with its arguments.
"""

import resource
import subprocess
import sys

subprocess.run(sys.argv[2:], stdout=subprocess.DEVNULL, check=True)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024)
