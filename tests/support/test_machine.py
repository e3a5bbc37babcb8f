"""What is known about the machine."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

from exudyn_partition.support.machine import alone, beside_other_work, others_busy


def test_who_shares_the_machine_is_not_alone():
    with subprocess.Popen(
        [sys.executable, "-c", "print(1, flush=True)\nwhile True: pass"], stdout=subprocess.PIPE
    ) as busy:
        busy.stdout.readline()
        found = [alone() for _ in range(50)]
        busy.kill()
    assert not all(found)


def test_a_thread_beside_other_work_takes_one_core():
    with beside_other_work():
        assert others_busy()
        assert not alone()
        with ThreadPoolExecutor(1) as second:
            assert not second.submit(others_busy).result()
    assert not others_busy()
