"""Bounds of a rate."""
import math


def upper_bound(found, count, level=0.95):
    """The rate that `found` in `count` runs leaves possible: 3/n when none, else Clopper and Pearson's one-sided bound."""
    if not count:
        return 1.0
    if not found:
        return min(1.0, 3.0 / count)
    low, high = found / count, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if at_most(found, count, middle) > 1.0 - level else (low, middle)
    return high


def at_most(found, count, rate):
    """Probability of at most `found` in `count` at this rate."""
    if rate >= 1.0:
        return 1.0 if found >= count else 0.0
    logs = (
        math.lgamma(count + 1) - math.lgamma(k + 1) - math.lgamma(count - k + 1) + k * math.log(rate) + (count - k) * math.log1p(-rate)
        for k in range(found + 1)
    )
    return sum(map(math.exp, logs))
