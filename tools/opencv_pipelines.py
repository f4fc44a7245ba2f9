"""Ways to find the papers' plate and its pennies with OpenCV, for compare_opencv.py: from a gray picture to corners and
centres, px. Plate and penny have the papers' sizes, parts are dark."""
import itertools

import cv2
import numpy as np

PLATE_MM, PENNY_MM = 203.2, 19.05
THRESHOLDS = [0.7, 0.75, 0.8, 0.85, 0.9]


class NotFound(Exception):
    """A pipeline found no table."""


def four_sides(lines):
    """The four strongest lines that are apart, as (distance, angle)."""
    sides = []
    for distance, angle in lines.reshape(-1, lines.shape[-1])[:, :2]:
        for d, a in sides:
            turn = abs(a - angle)
            near = abs(distance - d) if turn < np.pi / 2 else abs(distance + d)
            if min(turn, np.pi - turn) < np.radians(20) and near < 60:
                break
        else:
            sides.append((distance, angle))
            if len(sides) == 4:
                return sides
    raise NotFound


def corners_of(sides):
    """Where neighbouring sides meet, in the order round the table."""
    (_, first), *_ = sides
    parallel = [abs(np.cos(angle - first)) > 0.7 for _, angle in sides]
    one = [side for side, is_parallel in zip(sides, parallel) if is_parallel]
    other = [side for side, is_parallel in zip(sides, parallel) if not is_parallel]
    if len(one) != 2:
        raise NotFound
    meet = []
    for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)):
        (d, a), (e, b) = one[i], other[j]
        meet.append(np.linalg.solve([[np.cos(a), np.sin(a)], [np.cos(b), np.sin(b)]], [d, e]))
    return np.array(meet, np.float32)


def find_table(gray):
    """Corners, px; and the blurred picture."""
    blurred = cv2.GaussianBlur(gray, (5, 5), 1.2)
    edges = cv2.Canny(blurred, 60, 180)
    lines = cv2.HoughLines(edges, 1, np.radians(0.5), 200)
    if lines is None:
        raise NotFound
    corners = corners_of(four_sides(lines)).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 20, 0.01)
    return cv2.cornerSubPix(gray, corners, (5, 5), (-1, -1), criteria)[:, 0], blurred


def box_of(corners, gray):
    """First column and row of the plate's box, and the picture there."""
    (x, y), (right, bottom) = corners.min(0).astype(int), corners.max(0).astype(int) + 1
    x, y = max(x, 0), max(y, 0)
    return (x, y), gray[y:bottom, x:right]


def radius_of(corners):
    side = np.linalg.norm(np.roll(corners, 1, 0) - corners, axis=1).mean()
    return float(side) * PENNY_MM / PLATE_MM / 2


def darkness(corners, gray):
    """How much darker than the plate, none outside of it."""
    (x, y), box = box_of(corners, gray)
    level = int(np.median(box[::8, ::8]))
    inner = corners.mean(0) + (corners - corners.mean(0)) * 0.985 - (x, y)
    mask = np.zeros_like(box)
    cv2.fillConvexPoly(mask, inner.round().astype(np.int32), level)
    return (x, y), cv2.subtract(mask, box)


def disk(radius, margin=0):
    reach = int(np.ceil(radius)) + margin
    x = np.arange(-reach, reach + 1)
    return np.clip(radius + 0.5 - np.hypot(x, x[:, None]), 0, 1).astype(np.float32)


def by_filter(depth, source):
    def respond(dark, radius):
        kernel = disk(radius)
        return cv2.filter2D(dark.astype(source), depth, kernel / kernel.sum()), 0

    return respond


def by_template(method, source, margin):
    def respond(dark, radius):
        template = disk(radius, margin)
        template = (template * dark[::4, ::4].max()).astype(source)
        found = cv2.matchTemplate(dark.astype(source, copy=False), template, method)
        if method in (cv2.TM_SQDIFF, cv2.TM_SQDIFF_NORMED):
            # highest where the difference is none; a blank picture gives 0
            blank = float((template.astype(np.float32) ** 2).sum()) if method == cv2.TM_SQDIFF else 1.0
            found = cv2.subtract(blank, found)
        return found, template.shape[0] // 2

    return respond


def blob_centroids(response, least):
    _, _, _, centroids = cv2.connectedComponentsWithStats(cv2.compare(response, least, cv2.CMP_GT), connectivity=8)
    return centroids[1:]


def blob_moments(response, least):
    blobs, _ = cv2.findContours(cv2.compare(response, least, cv2.CMP_GT), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.array([blob.reshape(-1, 2).mean(0) for blob in blobs])


def maxima(response, least):
    dilated = cv2.dilate(response, np.ones((11, 11), np.uint8))
    peaks = cv2.bitwise_and(cv2.compare(response, dilated, cv2.CMP_EQ), cv2.compare(response, least, cv2.CMP_GT))
    at = cv2.findNonZero(peaks)
    x, y = at.reshape(-1, 2).T
    inside = (x > 0) & (y > 0) & (x < response.shape[1] - 1) & (y < response.shape[0] - 1)
    x, y = x[inside], y[inside]
    here = response[y, x].astype(float)

    def top(before, after):
        bend = before - 2 * here + after
        return np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1), 0)

    across = top(response[y, x - 1].astype(float), response[y, x + 1].astype(float))
    down = top(response[y - 1, x].astype(float), response[y + 1, x].astype(float))
    return np.stack([x + across, y + down], 1)


def kernel_pipeline(respond, read, threshold):
    def pipeline(gray):
        corners, _ = find_table(gray)
        first, dark = darkness(corners, gray)
        response, offset = respond(dark, radius_of(corners))
        centers = read(response, threshold * cv2.minMaxLoc(response)[1])
        return corners, np.asarray(centers).reshape(-1, 2) + offset + first

    return pipeline


def circle_pipeline(method, dp, edge, votes):
    def pipeline(gray):
        corners, blurred = find_table(gray)
        first, box = box_of(corners, blurred)
        radius = radius_of(corners)
        least, most = int(0.92 * radius), int(np.ceil(1.08 * radius))
        limits = {"minRadius": least, "maxRadius": most}
        found = cv2.HoughCircles(box, method, dp, 1.6 * radius, param1=edge, param2=votes, **limits)
        return corners, (np.empty((0, 2)) if found is None else found.reshape(-1, found.shape[-1])[:, :2] + first)

    return pipeline


def kernel_candidates():
    """Every kernel pipeline by name, for all thresholds."""
    u8, f32 = np.uint8, np.float32
    ways = {
        "filter2D, 8 bits": by_filter(-1, u8),
        "filter2D, 8 bits to f32": by_filter(cv2.CV_32F, u8),
        "filter2D, f32": by_filter(-1, f32),
    }
    for name in ["CCORR", "CCORR_NORMED", "CCOEFF", "CCOEFF_NORMED", "SQDIFF", "SQDIFF_NORMED"]:
        method = getattr(cv2, f"TM_{name}")
        for (depth, source), margin in itertools.product([("8 bits", u8), ("f32", f32)], [0, 4]):
            ways[f"matchTemplate {name}, {depth}, margin {margin}"] = by_template(method, source, margin)
    reads = {"components": blob_centroids, "contours": blob_moments, "maxima": maxima}
    for (way, respond), (how, read) in itertools.product(ways.items(), reads.items()):
        yield f"{way}; {how}", [kernel_pipeline(respond, read, threshold) for threshold in THRESHOLDS]


def circle_candidates():
    """Every HoughCircles pipeline by name, for all thresholds of votes."""
    for dp, edge in itertools.product([1, 1.5, 2, 3], [100, 200, 300]):
        for name, votes in (("GRADIENT", [8, 12, 16, 20, 25, 30, 40]), ("GRADIENT_ALT", [0.6, 0.8, 0.9])):
            method = getattr(cv2, f"HOUGH_{name}")
            yield f"{name}, dp {dp}, edge {edge}", [circle_pipeline(method, dp, edge, v) for v in votes]
