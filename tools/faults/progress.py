"""O4: a run that plays pulses without true progress ends. Progress is judged from the true places."""
import math

from . import claims

FUTILE, NEAR, DETOUR = 20, 100, 200
# these are for as many parts as one motion serves; more take turns, and every pair of them may hinder each other
SERVED = 8
# cycles of motions without pauses that are as long as one with them
SEGMENTS = 5
# the program judges by what it sees: as many cycles more, since small steps look different to it, and progress that looks
# like 1 % or 5 % to it may truly be a fifth less
SLACK = 5
NEAR_TOLERANCES, SHARE, PART_SHARE, NEW_MM = 6.0, 0.008, 0.04, 1.0


def violations(run):
    if not run.truth:
        return
    watch = Watch(run.job["task"]["type"] in ("plus_sign", "trajectories"), run.tolerance_mm, SEGMENTS if run.is_moving else 1)
    played = False
    for cycle in run.cycles:
        true = [part[:2] for part in run.truth_at(cycle["observed_at_s"])]
        why = watch.look(cycle, true, played)
        if why:
            # equal parts that changed places between two frames are followed under each other's name
            exchanged = any(claims.unseen_exchanges(run, true))
            yield "O4", f"{why} by {cycle['observed_at_s']:.3f} s", exchanged
            return
        # the rest of a sequence of rotations may lead away before it leads near: it counts as one plan with its beginning
        played = bool(cycle["sent"]) and not cycle.get("plan", {}).get("continues")


class Watch:
    """Counts cycles with pulses since the true places came nearer to the targets, the subgoals, or one part to its target."""

    def __init__(self, follows_paths, tolerance_mm, segments=1):
        self.follows_paths, self.tolerance_mm, self.segments = follows_paths, tolerance_mm, segments
        self.targets, self.subgoals, self.least = [], [], {}
        self.futile = self.detour = 0
        self.moved_from = None

    def look(self, cycle, true, played):
        """What is wrong, in words, or `None`."""
        targets, subgoals = cycle["wanted"]["targets_mm"], cycle["wanted"]["subgoals_mm"]
        if subgoals == cycle["observed_mm"]:
            # every part is let be
            self.__init__(self.follows_paths, self.tolerance_mm, self.segments)
            return None
        if targets != self.targets:
            self.targets, self.least["targets"] = targets, distance(true, targets)
            self.least |= {i: math.dist(*pair) for i, pair in enumerate(zip(true, targets))}
        if len(self.subgoals) != len(subgoals) or farthest(self.subgoals, subgoals) > NEW_MM:
            self.subgoals, self.least["subgoals"] = subgoals, distance(true, subgoals)
        nearer = self.improves("targets", distance(true, targets), SHARE)
        gets_on = self.improves("subgoals", distance(true, subgoals), SHARE)
        ones = [i for i, pair in enumerate(zip(true, targets)) if self.gets_on(i, math.dist(*pair))]
        gets_on = gets_on or bool(ones) or (self.follows_paths and self.has_moved(true))
        self.futile = 0 if nearer or gets_on else self.futile + played
        self.detour = 0 if nearer or self.follows_paths else self.detour + played
        turns = self.segments * max(1.0, len(true) / SERVED) ** 2
        bar = turns * (NEAR if farthest(true, targets) < NEAR_TOLERANCES * self.tolerance_mm else FUTILE)
        if self.futile > bar + SLACK * self.segments:
            return f"{self.futile} cycles with pulses and no true progress, bar {bar:.0f}"
        return f"{self.detour} cycles with pulses on a detour, bar {turns * DETOUR:.0f}" if self.detour > turns * DETOUR + SLACK * self.segments else None

    def improves(self, measure, now, share):
        better = now < (1.0 - share) * self.least[measure]
        if better:
            self.least[measure] = now
        return better

    def gets_on(self, part, now):
        return self.least[part] > self.tolerance_mm and self.improves(part, now, PART_SHARE)

    def has_moved(self, true):
        """On a path a part that truly moves gets on."""
        if self.moved_from is None or farthest(self.moved_from, true) > NEW_MM:
            self.moved_from = true
            return True
        return False


def distance(from_mm, to_mm):
    return math.sqrt(sum(math.dist(*pair) ** 2 for pair in zip(from_mm, to_mm)))


def farthest(from_mm, to_mm):
    return max((math.dist(*pair) for pair in zip(from_mm, to_mm)), default=0.0)
