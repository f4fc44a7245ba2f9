"""How much of a recording a killed daemon left: held row by row against the same job's whole run.

Equal job, seed and program give equal runs, so that a whole recording, made by `upm run`, tells which rows the broken one
should have. A row is due when the run has come to tell it: a look when it is taken, a pulse's trace when the pulse is over,
a cycle's plan and errors when the cycle ends. Reads with rerun-sdk, which has to be installed.
"""
import collections
import json

from rerun.experimental import RrdReader

TIMELINE = "plate_time"
# rows of the signals of a pulse are written when it is over
SIGNALS = ("/motors", "/accelerometers")
MICROSECOND_NS = 1000
# how an event begins that tells of a recording which ended before its run
EARLY_END = "the recording ends early: "


def chunks_of(path):
    """What a recording holds; nothing where the run was killed before the first of it."""
    reader = RrdReader(str(path))
    return reader.stream() if reader.recordings() else []


def series_of(path):
    """Times of the rows of every series (entity and component), ns, sorted."""
    found = collections.defaultdict(list)
    for chunk in chunks_of(path):
        if chunk.is_static or TIMELINE not in chunk.timeline_names:
            continue
        batch = chunk.to_record_batch()
        times = batch.column(batch.schema.names.index(TIMELINE)).cast("int64").to_pylist()
        for name, column in zip(batch.schema.names, batch.columns):
            if ":" in name:
                rows = zip(times, column.is_valid().to_pylist())
                found[str(chunk.entity_path), name].extend(at for at, is_valid in rows if is_valid)
    return {key: sorted(times) for key, times in found.items()}


def texts_of(path):
    """What stands in the recording's log."""
    texts = []
    for chunk in chunks_of(path):
        if str(chunk.entity_path) == "/log" and not chunk.is_static:
            batch = chunk.to_record_batch()
            if "TextLog:text" in batch.schema.names:
                texts += [row[0] for row in batch.column(batch.schema.names.index("TextLog:text")).to_pylist() if row]
    return texts


def cycles_of(journal):
    """The whole lines of a journal, but for events and for the pulses of a cycle that was broken off: how the run came to
    its end."""
    lines = journal[: journal.rfind(b"\n") + 1].splitlines(keepends=True)
    return b"".join(line for line in lines if not line.startswith((b'{"type":"event"', b'{"type":"unfinished_cycle"')))


class Whole:
    """A whole run: its journal, and for every series when each row is due, s of plate time."""

    def __init__(self, folder):
        self.journal = cycles_of((folder / "journal.jsonl").read_bytes())
        lines = [json.loads(line) for line in self.journal.splitlines()]
        self.cycles = [line for line in lines if line["type"] == "cycle"]
        starts, ends = ([round(1e6 * cycle[key]) for cycle in self.cycles] for key in ("observed_at_s", "ended_at_s"))
        self.end_of_start = dict(zip(starts, ends))
        self.pulses = [
            (sent["started_at_s"], sent["started_at_s"] + 2.0 * sent["attack_s"] + sent["sustain_s"])
            for cycle in self.cycles
            for sent in cycle["sent"]
        ]
        self.series = series_of(folder / "run.rrd")
        self.due_s = {key: self.due(key, times) for key, times in self.series.items()}

    def due(self, key, times):
        """When the rows of a series are due."""
        entity, _ = key
        if entity.startswith(SIGNALS):
            return self.after_pulses(times)
        first = round(1e6 * self.cycles[0]["observed_at_s"])
        by_start = [round(at / MICROSECOND_NS) for at in times]
        # told at the end of the cycle, as of its start
        is_of_cycles = len(times) == len(self.cycles) and by_start[0] == first
        if is_of_cycles or entity == "/log":
            return [1e-6 * self.end_of_start.get(at, at) for at in by_start]
        return [1e-9 * at for at in times]

    def after_pulses(self, times):
        due, pulses = [], iter(self.pulses)
        end_s, next_pulse = 0.0, next(pulses, None)
        for at in times:
            while next_pulse and 1e-9 * at >= next_pulse[0] - 1e-9:
                end_s, next_pulse = next_pulse[1], next(pulses, None)
            due.append(max(end_s, 1e-9 * at))
        return due

    def first_missing_s(self, recording):
        """For every series when the first row was due that the recording does not have; None where it has all."""
        found, missing = series_of(recording), {}
        for key, times in self.series.items():
            there = found.get(key, [])
            index = next((i for i, at in enumerate(times) if i >= len(there) or there[i] != at), None)
            missing[key] = None if index is None else self.due_s[key][index]
        return missing

    def journal_until_s(self, journal):
        """When the first line of the journal was due that is not there; None when it is not the begin of this run's."""
        whole_lines = cycles_of(journal)
        if not self.journal.startswith(whole_lines):
            return None
        count = whole_lines.count(b'{"type":"cycle"')
        return self.cycles[count]["ended_at_s"] if count < len(self.cycles) else float("inf")
