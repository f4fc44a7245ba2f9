use super::clearance::{REST_GAP_M, REST_MARGIN_M, ROUNDING_M, check_inside};
use super::task::{TaskContext, TaskSpec};
use upm_core::document::{Diagnostics, Path};
use upm_core::geometry::Vec2;
use upm_core::job::Bin;
use upm_core::units::mm_from_m;
use upm_planning::task::BinParams;

impl TaskContext<'_> {
    /// The bins in SI. Faults: a kind or part without a bin or in several, a bin too small for its parts, bins that
    /// overlap.
    pub(super) fn sort(&self, entries: &[Bin], faults: &mut Diagnostics) -> Option<TaskSpec> {
        let at = self.at.key("bins");
        let (mut named, mut kinds) = (Vec::new(), Vec::new());
        let mut bins: Vec<BinParams> = Vec::with_capacity(entries.len());
        for (i, entry) in entries.iter().enumerate() {
            let before = named.len();
            self.add_named(&entry.parts, &at.index(i).key("parts"), &mut named, faults);
            let parts = named.get(before..).unwrap_or_default().to_vec();
            bins.push(BinParams { parts, min_m: entry.region.min_m, max_m: entry.region.max_m });
        }
        for (i, (entry, bin)) in entries.iter().zip(&mut bins).enumerate() {
            let at = at.index(i);
            let is_of_some = !(entry.kinds.is_empty() && entry.parts.is_empty());
            faults.require(is_of_some, at.key("kinds"), "a bin for nothing", "kinds, names of parts, or both");
            for (k, name) in entry.kinds.iter().enumerate() {
                let Some(kind) = self.rig.known_kind(name, &at.key("kinds").index(k), faults) else { continue };
                let found = format!("{name:?} a second time");
                if faults.require(!kinds.contains(&kind), at.key("kinds").index(k), found, "each kind in one bin") {
                    kinds.push(kind);
                    bin.parts.extend(
                        (0..self.kinds.len()).filter(|part| self.kinds[*part] == kind && !named.contains(part)),
                    );
                }
            }
            self.check_bin(bin, &at.key("region_mm"), faults);
        }
        for (i, bin) in bins.iter().enumerate() {
            // a common border is allowed
            let common_m = |other: &BinParams| bin.max_m.inf(&other.max_m) - bin.min_m.sup(&other.min_m);
            let overlapped = bins.iter().enumerate().take(i).find(|(_, other)| common_m(other).min() > ROUNDING_M);
            if let Some((k, other)) = overlapped {
                let found = format!("{} over {}, {}", text_of_bin(bin), at.index(k), text_of_bin(other));
                faults.push(at.index(i).key("region_mm"), found, "bins that do not overlap");
            }
        }
        for (kind, spec) in self.rig.kinds.iter().enumerate() {
            let is_in_none = |part: &usize| !bins.iter().any(|bin| bin.parts.contains(part));
            let parts = (0..self.kinds.len()).filter(|part| self.kinds[*part] == kind && is_in_none(part)).count();
            let found = format!("no bin for {}, {parts} of them on the plate", spec.kind.name);
            faults.require(parts == 0, &at, found, "a bin for every kind of part");
        }
        Some(TaskSpec::Sort { bins })
    }

    fn check_bin(&self, bin: &BinParams, at: &Path, faults: &mut Diagnostics) {
        for (name, corner_m) in [("min", bin.min_m), ("max", bin.max_m)] {
            check_inside(corner_m, 0.0, self.half_m, 0.0, &at.key(name), faults);
        }
        let is_rectangle = (bin.max_m - bin.min_m).min() > 0.0;
        if faults.require(is_rectangle, at, text_of_bin(bin), "min below max along x and y") {
            self.check_room(bin, at, faults);
        }
    }

    /// Reports a bin whose parts do not fit in straight rows with [`REST_GAP_M`] between rims and half of that to the
    /// bin's border, beyond which the next bin may begin. All parts are assumed as large as the largest, as the goal
    /// does when it assigns slots.
    fn check_room(&self, bin: &BinParams, at: &Path, faults: &mut Diagnostics) {
        let count = bin.parts.len();
        let radius_m = bin.parts.iter().map(|&part| self.radii_m[part]).fold(0.0, f64::max);
        let most_m = Vec2::repeat(self.half_m - REST_MARGIN_M);
        let inset_m = Vec2::repeat(0.5 * REST_GAP_M);
        let free_m = (bin.max_m - inset_m).inf(&most_m) - (bin.min_m + inset_m).sup(&-most_m);
        let room = in_rows(free_m, radius_m, REST_GAP_M);
        let (size_mm, diameter_mm) = ((bin.max_m - bin.min_m).map(mm_from_m), mm_from_m(2.0 * radius_m));
        let [gap, border, edge] = [REST_GAP_M, 0.5 * REST_GAP_M, REST_MARGIN_M].map(mm_from_m);
        let found = format!("{:.3} x {:.3} mm with room for {room} of {diameter_mm:.3} mm", size_mm.x, size_mm.y);
        let allowed = format!(
            "room for {count}, its parts (with {gap:.3} mm between rims, {border:.3} mm to the border and \
             {edge:.3} mm to the plate's edge)"
        );
        faults.require(room >= count, at, found, allowed);
    }
}

/// Text for messages: `[-60, 0] to [-20, 40.5]`, mm.
fn text_of_bin(bin: &BinParams) -> String {
    let corner = |p: Vec2| format!("[{:.3}, {:.3}]", mm_from_m(p.x), mm_from_m(p.y));
    format!("{} to {}", corner(bin.min_m), corner(bin.max_m))
}

/// Number of discs of `radius_m` with `gap_m` between rims that fit in straight rows and columns in a rectangle of
/// `size_m`. Interlocked rows hold more, but parts could not get in and past each other.
fn in_rows(size_m: Vec2, radius_m: f64, gap_m: f64) -> usize {
    let along = |length_m: f64| {
        let centers_m = length_m - 2.0 * radius_m + ROUNDING_M;
        if centers_m < 0.0 { 0 } else { (centers_m / (2.0 * radius_m + gap_m)) as usize + 1 }
    };
    along(size_m.x).saturating_mul(along(size_m.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(width: f64, height: f64, gap: f64) -> usize {
        in_rows(Vec2::new(width, height), 1.0, gap)
    }

    #[test]
    fn rows_hold_as_many_parts_as_fit() {
        assert_eq!(number(6.0, 4.0, 0.0), 6);
        assert_eq!(number(5.99, 4.0, 0.0), 4);
        assert_eq!(number(2.0, 2.0, 5.0), 1);
        assert_eq!(number(1.99, 30.0, 0.0), 0);
        assert_eq!(number(6.2, 4.2, 0.1), 6);
        assert_eq!(number(6.19, 4.2, 0.1), 4);
    }
}
