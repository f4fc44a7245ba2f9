"""Traffic on a daemon: clients that watch the events of running jobs, and a steady rate of requests.

Each of the two is one process with one asyncio loop on raw sockets with keep-alive. Both are niced, so that they take no time
from the plates, and apart, so that a burst of events to 64 clients is not counted as the time that a request took.
"""
import asyncio
import collections
import contextlib
import json
import multiprocessing
import os
import random
import time
from dataclasses import dataclass, field

from daemon_lib import hold
from common import percentile
from upm_daemon import Answer, DaemonFault

# requests are asked for at the niceness of those who answer
NICENESS = {"watching": 10, "asking": 5}
# shares of the requests, by what they ask; a tenth are POSTs
MIX = {"list": 0.2, "show": 0.25, "plates": 0.25, "healthz": 0.1, "metrics": 0.1, "submit": 0.05, "cancel": 0.05}
JOB_REQUESTS = ("list", "show", "submit", "cancel")
WANTED = {"submit": {201}, "cancel": {200}}
# jobs that wait on the held plate; more than this are cancelled before others are submitted
MOST_WAITING = 24
# no answer may take longer, s
LONGEST_S = 30.0
# how long a client watches before it comes back with the last number it saw, s
WATCHES_S = (5.0, 40.0)
# between looks at which jobs are running, s
LOOK_EVERY_S = 0.1


@dataclass
class Link:
    """A connection that is kept between requests; the daemon may close it while it rests."""

    address: tuple
    headers: str = ""
    reader: asyncio.StreamReader = None
    writer: asyncio.StreamWriter = None

    async def open(self):
        self.reader, self.writer = await asyncio.open_connection(*self.address)

    def drop(self):
        if self.writer:
            self.writer.close()
        self.reader = self.writer = None

    def send(self, method, path, body=None, extra=""):
        host = f"{self.address[0]}:{self.address[1]}"
        head = f"{method} {path} HTTP/1.1\r\nHost: {host}\r\n{self.headers}{extra}"
        if body is not None:
            head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n"
        elif method == "POST":
            head += "Content-Length: 0\r\n"
        self.writer.write(head.encode() + b"\r\n" + (body or b""))

    async def ask(self, method, path, body=None, extra=""):
        """The answer; tried once more on a new connection when the old one was closed meanwhile."""
        for is_last in (False, True):
            was_open = self.writer is not None
            if not was_open:
                await self.open()
            try:
                begin = time.perf_counter()
                self.send(method, path, body, extra)
                return await self.answer(begin)
            except (ConnectionError, asyncio.IncompleteReadError):
                self.drop()
                if is_last or not was_open:
                    raise

    async def head(self):
        lines = (await self.reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
        headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines[1:] if line)}
        return int(lines[0].split(" ", 2)[1]), headers

    async def answer(self, begin):
        status, headers = await self.head()
        if headers.get("transfer-encoding") == "chunked":
            body = b"".join([piece async for piece in self.chunks()])
        else:
            length = 0 if status in (204, 304) else int(headers.get("content-length", 0))
            body = await self.reader.readexactly(length)
        wall_s = time.perf_counter() - begin
        if headers.get("connection", "").lower() == "close":
            self.drop()
        return Answer(status, headers, body, wall_s)

    async def chunks(self):
        """The pieces of a body that is sent in pieces."""
        while size := int((await self.reader.readline()).split(b";")[0] or b"0", 16):
            yield await self.reader.readexactly(size)
            await self.reader.readexactly(2)
        await self.reader.readline()


async def events_of(link, job_id, last=None):
    """Server-sent events of a job as (kind, id or None, data); ends with the stream. Comments are left out."""
    await link.open()
    link.send("GET", f"/v1/jobs/{job_id}/events", extra="" if last is None else f"Last-Event-ID: {last}\r\n")
    status, _ = await link.head()
    if status != 200:
        raise DaemonFault(f"events of {job_id}: {status}")
    pending = b""
    async for piece in link.chunks():
        *whole, pending = (pending + piece).split(b"\n\n")
        for block in whole:
            fields = dict(line.partition(b":")[::2] for line in block.split(b"\n") if not line.startswith(b":"))
            if b"data" in fields:
                number = fields.get(b"id")
                yield fields.get(b"event", b"message").strip().decode(), number and int(number), fields[b"data"].strip()


@dataclass
class Counts:
    """What the traffic met with."""

    wall_ms: dict = field(default_factory=lambda: collections.defaultdict(list))
    statuses: collections.Counter = field(default_factory=collections.Counter)
    events: collections.Counter = field(default_factory=collections.Counter)
    faults: collections.Counter = field(default_factory=collections.Counter)

    def unwanted(self):
        """Answers that should not have been, as `submit 503`."""
        return {f"{kind} {status}": n for (kind, status), n in self.statuses.items() if status not in WANTED.get(kind, {200})}

    def job_requests_ms(self):
        return [ms for kind in JOB_REQUESTS for ms in self.wall_ms[kind]]

    def lines(self):
        """A table of the requests by kind."""
        yield f"{'request':8} {'count':>7} {'p50 ms':>8} {'p99 ms':>8} {'max ms':>8}  statuses"
        for kind in MIX:
            found = self.wall_ms[kind]
            statuses = ", ".join(f"{status}: {n}" for (of, status), n in sorted(self.statuses.items()) if of == kind)
            times = " ".join(f"{percentile(found, share):8.2f}" for share in (0.5, 0.99, 1.0))
            yield f"{kind:8} {len(found):7d} {times}  {statuses}"
        yield f"events   {dict(self.events)}"


class Half:
    """One of the two processes."""

    name = ""

    def __init__(self, address, seed):
        self.address, self.rng = address, random.Random(seed)
        self.counts, self.stopping = Counts(), multiprocessing.Event()
        self.here, self.there = multiprocessing.Pipe(duplex=False)
        self.child = multiprocessing.Process(target=self.in_child, daemon=True)
        self.child.start()

    def finish(self):
        """Ends it; its counts."""
        self.stopping.set()
        counts = self.here.recv()
        self.child.join()
        return counts

    def in_child(self):
        os.nice(NICENESS[self.name])
        asyncio.run(self.run())
        self.there.send(self.counts)

    async def run(self):
        tasks = [asyncio.create_task(loop) for loop in self.loops()]
        try:
            await self.work()
        finally:
            for task in tasks:
                task.cancel()
        for fault in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(fault, Exception):
                self.counts.faults[f"{self.name} broke: {fault!r}"[:80]] += 1

    def loops(self):
        return []

    def is_over(self):
        return self.stopping.is_set() or not multiprocessing.parent_process().is_alive()


class Asking(Half):
    """Requests at a steady rate, whether those before were answered or not."""

    name = "asking"

    def __init__(self, held, rate_hz, *others):
        self.held, self.rate_hz, self.number = held, rate_hz, 0
        self.known, self.waiting, self.free = collections.deque(maxlen=50), [], []
        super().__init__(*others)

    async def work(self):
        begin, sent, asked = time.monotonic(), 0, set()
        while not self.is_over():
            rest = begin + sent / self.rate_hz - time.monotonic()
            if rest > 0:
                await asyncio.sleep(rest)
            kind = self.pick()
            # chosen and taken in one step: a job that waits is cancelled by one request only
            task = asyncio.create_task(self.request(kind, *self.what(kind)))
            asked.add(task)
            task.add_done_callback(asked.discard)
            sent += 1
        await asyncio.gather(*asked)

    def pick(self):
        kind = self.rng.choices(list(MIX), MIX.values())[0]
        if kind in ("submit", "cancel"):
            kind = "cancel" if len(self.waiting) > MOST_WAITING else kind if self.waiting else "submit"
        return "list" if kind == "show" and not self.known else kind

    async def request(self, kind, method, path, body):
        link = self.free.pop() if self.free else Link(self.address)
        try:
            answer = await asyncio.wait_for(link.ask(method, path, body), LONGEST_S)
        except (OSError, asyncio.IncompleteReadError, asyncio.TimeoutError) as fault:
            self.counts.faults[f"{kind}: {type(fault).__name__}"] += 1
            link.drop()
            return
        self.free.append(link)
        self.counts.wall_ms[kind].append(1e3 * answer.wall_s)
        self.counts.statuses[kind, answer.status] += 1
        if kind == "submit" and answer.status == 201:
            self.waiting.append(answer.json()["id"])
            self.known.append(self.waiting[-1])
        elif kind == "plates" and answer.status == 200:
            self.known.extend(plate["job"] for plate in answer.json()["plates"] if plate["job"])

    def what(self, kind):
        if kind == "submit":
            self.number += 1
            return "POST", "/v1/jobs", json.dumps(hold(self.held, 1.0, self.number, "waits")).encode()
        if kind == "cancel":
            return "POST", f"/v1/jobs/{self.waiting.pop(0)}/cancel", None
        paths = {"list": "/v1/jobs?limit=20", "plates": "/v1/plates", "healthz": "/healthz", "metrics": "/metrics"}
        return "GET", paths.get(kind) or f"/v1/jobs/{self.rng.choice(self.known)}", None


class Watching(Half):
    """Clients that watch one running job after another; they break off at times and resume from the last offset seen."""

    name = "watching"

    def __init__(self, watchers, *others):
        self.watchers, self.running, self.over = watchers, [], set()
        super().__init__(*others)

    def loops(self):
        return [self.watch(random.Random(self.rng.random())) for _ in range(self.watchers)]

    async def work(self):
        link = Link(self.address)
        while not self.is_over():
            with contextlib.suppress(OSError, asyncio.IncompleteReadError):
                answer = await link.ask("GET", "/v1/plates")
                found = {plate["job"] for plate in answer.json()["plates"] if plate["job"]}
                self.running = sorted(found - self.over)
            await asyncio.sleep(LOOK_EVERY_S)

    async def watch(self, rng):
        while True:
            if not self.running:
                await asyncio.sleep(LOOK_EVERY_S)
                continue
            job, last = rng.choice(self.running), 0
            while last is not None:
                last = await self.watch_once(job, last, time.monotonic() + rng.uniform(*WATCHES_S))

    async def watch_once(self, job, last, until):
        """The offset in the journal to resume from; None when the job is over."""
        link = Link(self.address)
        try:
            async for kind, offset, data in events_of(link, job, last):
                self.counts.events[kind] += 1
                if kind == "job":
                    if json.loads(data)["finished_at"] is not None:
                        self.over.add(job)
                        self.running = [other for other in self.running if other != job]
                        return None
                else:
                    if offset != last + len(data) + 1:
                        self.counts.faults["a line is missing on a stream, or came twice"] += 1
                    last = offset
                if time.monotonic() > until:
                    self.counts.events["(resumed)"] += 1
                    return last
            self.counts.faults["a stream ended before its job"] += 1
        except (OSError, asyncio.IncompleteReadError, DaemonFault) as fault:
            self.counts.faults[f"events: {type(fault).__name__} {fault}"[:80]] += 1
            await asyncio.sleep(LOOK_EVERY_S)
        finally:
            link.drop()
        return last


class Traffic:
    """`args.watchers` clients on the jobs of all plates, and `args.rate` requests a second.

    Jobs are submitted to the plate `held`, which is paused.
    """

    def __init__(self, address, held, args):
        self.halves = [Asking(held, args.rate, address, args.seed), Watching(args.watchers, address, args.seed)]

    def finish(self):
        """Ends both; all they counted."""
        asking, watching = (half.finish() for half in self.halves)
        asking.faults += watching.faults
        asking.events += watching.events
        return asking


def judge_traffic(bars, counts):
    bars.hold("answers to the traffic that should not be", "none", counts.unwanted() or "none", not counts.unwanted())
    bars.hold("the traffic's connections and streams", "no fault", dict(counts.faults) or "no fault", not counts.faults)
