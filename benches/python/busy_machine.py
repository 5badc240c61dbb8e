"""What other programs cost: ``python benches/python/busy_machine.py [--loops 2]``, transfers without landmarks beside
busy loops.

Wall time of the bundled examples' transfers, alone and then beside processes that never wait. With as many loops as
cores, a fair share of the machine is half of it: twice the time is what cannot be helped.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time

import patchtransfer as pt
from patchtransfer import examples


def seconds(name: str, repeat: int) -> list[float]:
    """Wall times of one example's transfer."""
    source, target, _ = examples.load(name)
    found = []
    for _ in range(repeat):
        begin = time.perf_counter()
        pt.transfer(source, target)
        found.append(time.perf_counter() - begin)
    return found


def main() -> None:
    """Print median and longest times alone and beside the loops."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--loops", type=int, default=os.cpu_count() or 1, help="busy loops (default one a core)")
    parser.add_argument("--repeat", type=int, default=5, help="transfers of every example (default 5)")
    options = parser.parse_args()
    for name in examples.EXAMPLES:
        seconds(name, 1)
        alone = statistics.median(seconds(name, options.repeat))
        loops = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(options.loops)]
        try:
            beside = seconds(name, options.repeat)
        finally:
            for loop in loops:
                loop.kill()
                loop.wait()
        middle, longest = statistics.median(beside), max(beside)
        print(
            f"{name}: alone {alone:.3f} s, beside {options.loops} loops {middle:.3f} s ({middle / alone:.2f} times), "
            f"longest {longest:.3f} s ({longest / alone:.2f} times)",
            flush=True,
        )


if __name__ == "__main__":
    main()
