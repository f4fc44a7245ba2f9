#!/usr/bin/env python3
"""Memory of the daemon over short jobs, one after another.

usage: daemon_memory.py [--jobs 500] [--every 50] [--live on] [--upm target/debug/upm]

Jobs are as fast as the machine can, recorded as always, on one plate; before the next is submitted the one before has
ended. Memory is read after the first 50 and then every 50: resident, proportional and private. Exit status 1 when
resident or private memory grew by more than 10 % after the first 50.
"""
import sys
import time

from daemon_lib import Bars, Daemon, memory_mb, parser_of, say, short_arrange, work_folder, write_config

GROWTH_BAR = 0.10
# what the last job leaves to other threads is done by then
REST_S = 1.0


def main():
    parser = parser_of(__doc__)
    parser.add_argument("--jobs", type=int, default=500)
    parser.add_argument("--every", type=int, default=50)
    parser.add_argument("--live", choices=("on", "off"), default="off", help="the plate's live stream, which keeps a history")
    args = parser.parse_args()
    found, states, begin = {}, {}, time.monotonic()
    with work_folder(args.keep) as folder:
        config = write_config(folder, {"upm-2": "upm-2"}, live={"rerun": args.live == "on"})
        with Daemon(args.upm, folder, config).start() as daemon:
            for number in range(1, args.jobs + 1):
                job = daemon.submit(short_arrange("upm-2", seed=number), pace="max")
                state = daemon.wait_end(job["id"], 60.0)["state"]
                states[state] = states.get(state, 0) + 1
                if number % args.every == 0 or number == args.jobs:
                    time.sleep(REST_S)
                    found[number] = memory_mb(daemon.pid)
                    say(f"  after {number}: " + ", ".join(f"{name} {mb:.1f} MB" for name, mb in found[number].items()))
    print(f"{'jobs':>5}" + "".join(f"{name + ' MB':>12}" for name in next(iter(found.values()))))
    for number, row in found.items():
        print(f"{number:5d}" + "".join(f"{mb:12.1f}" for mb in row.values()))
    print()
    bars, first, last = Bars(), min(found), max(found)
    bars.hold("jobs completed", args.jobs, states, states == {"completed": args.jobs})
    for name in ("VmRSS", "Private"):
        growth = found[last][name] / found[first][name] - 1.0
        what = f"growth of {name} from job {first} to {last}"
        bars.hold(what, f"<= {100 * GROWTH_BAR:g} %", f"{100 * growth:+.1f} %", growth <= GROWTH_BAR)
    bars.tell("a job took, s", f"{(time.monotonic() - begin) / args.jobs:.2f}")
    sys.exit(bars.close())


if __name__ == "__main__":
    main()
