"""What is known about the machine."""

import subprocess
import sys

from exudyn_partition.support.machine import alone


def test_who_shares_the_machine_is_not_alone():
    with subprocess.Popen(
        [sys.executable, "-c", "print(1, flush=True)\nwhile True: pass"], stdout=subprocess.PIPE
    ) as busy:
        busy.stdout.readline()
        found = [alone() for _ in range(50)]
        busy.kill()
    assert not all(found)
