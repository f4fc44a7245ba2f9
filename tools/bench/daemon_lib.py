"""What the campaigns against `upm serve` share: options, a daemon in a folder of their own, job bodies."""
import contextlib
import os
import pathlib
import sys
import tempfile

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1]))
from common import ROOT, parser_of  # noqa: E402
from upm_daemon import Daemon  # noqa: E402


def say(text):
    """Progress, on stderr."""
    print(text, file=sys.stderr, flush=True)


def options_of(doc, **options):
    """The options of a campaign, those that every one has among them."""
    parser = parser_of(doc, seed=1, **options)
    parser.add_argument("--keep", type=pathlib.Path, help="empty folder to work in, kept afterwards; else a temporary one")
    return parser.parse_args()


@contextlib.contextmanager
def serving(args, plates, **others):
    """A daemon on `plates` (names of rigs by names of plates) in `args.keep`, or in a folder that is gone afterwards."""
    with contextlib.ExitStack() as stack:
        folder = args.keep or pathlib.Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="upm-daemon-")))
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            sys.exit(f"{folder} is not empty: what is left there would be taken for this campaign's")
        rigs = {name: str(ROOT / f"configs/rigs/{rig}.json") for name, rig in plates.items()}
        yield stack.enter_context(Daemon(args.upm, folder.resolve(), rigs, **others))


def hold_plate(daemon, name):
    """Leaves the plate paused: whatever is queued for it waits."""
    daemon.act(name, "estop")
    daemon.reset(name, "to hold it")


def plus_sign(plate, laps=0, plate_time_s=600.0, seed=7, name="plus-sign"):
    """A penny along the plus sign; without laps until its time is up."""
    task = {"type": "plus_sign", "laps": laps, "edge_margin_mm": 8}
    return job(plate, name, [{"kind": "penny"}], task, plate_time_s, seed)


def hold(plate, duration_s, seed=7, name="hold"):
    """A penny that stays where it is: nothing moves."""
    return job(plate, name, [{"kind": "penny"}], {"type": "hold", "duration_s": duration_s}, 600.0, seed)


def short_arrange(plate, seed=7, name="short"):
    """A penny that goes some millimetres: half a second of plate time or so."""
    task = {"type": "arrange", "targets_mm": [[6.0, 0.0]]}
    return job(plate, name, [{"kind": "penny", "position_mm": [0.0, 0.0]}], task, 60.0, seed)


def job(plate, name, parts, task, plate_time_s, seed):
    limits = {"plate_time_s": plate_time_s}
    return {"name": name, "plate": plate, "seed": seed, "parts": parts, "task": task, "limits": limits}


def stolen_s():
    """Time that the host of a virtual machine had taken from all cores, s; 0 where it is not counted."""
    fields = pathlib.Path("/proc/stat").read_text().split("\n")[0].split()
    return int(fields[8]) / os.sysconf("SC_CLK_TCK") if len(fields) > 8 else 0.0
