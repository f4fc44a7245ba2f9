use super::raw::{RawDisplacement, RawEntry, RawLibrary};
use super::{Library, LibraryFault};
use crate::geometry::Vec2;

/// Fewest entries that can steer a part.
const MIN_ENTRIES: usize = 3;

/// Two directions count as two when the flows at the centre spread by more than about 6 degrees.
const MIN_SPREAD: f64 = 0.01;

impl TryFrom<RawLibrary> for Library {
    type Error = Vec<LibraryFault>;

    /// Validates; every fault is listed, with its file still blank.
    fn try_from(raw: RawLibrary) -> Result<Self, Self::Error> {
        let mut faults = Faults(Vec::new());
        faults.check_head(&raw);
        faults.check_entries(&raw.entries);
        faults.check_displacement(&raw.displacement);
        let library = raw.into_library();
        if faults.0.is_empty() && spread_at_center(&library) < MIN_SPREAD {
            faults.add("entries", "parts at the centre flow in one direction only", "flows in two directions");
        }
        if faults.0.is_empty() { Ok(library) } else { Err(faults.0) }
    }
}

impl Library {
    /// Refuses a library that was measured on another rig: distances and centres hold for one rig only.
    pub fn check_fits(&self, rig_name: &str, fingerprint: &str) -> Result<(), LibraryFault> {
        if self.rig != rig_name {
            return Err(LibraryFault::new(
                "rig",
                format!("{:?}", self.rig),
                format!("{rig_name:?}, the rig of this run"),
            ));
        }
        if self.fingerprint != fingerprint {
            let allowed = format!("{fingerprint:?}: the rig's file has changed, calibrate again");
            return Err(LibraryFault::new("fingerprint", format!("{:?}", self.fingerprint), allowed));
        }
        Ok(())
    }

    /// Entries that the rig's motors cannot reach: their waveforms peak above `count_limit`.
    pub fn unreachable_entries(&self, count_limit: f64) -> Vec<LibraryFault> {
        let peak = |entry: usize| self.drive(entry, 0.0).map_or(0.0, |drive| drive.peak_counts());
        let fault = |(entry, peak): (usize, f64)| {
            let allowed = format!("amplitudes whose waveform peaks at {count_limit:.0} counts or less");
            LibraryFault::new(format!("entries[{entry}].amplitudes"), format!("a peak of {peak:.0} counts"), allowed)
        };
        let peaks = (0..self.entries.len()).map(|entry| (entry, peak(entry)));
        peaks.filter(|&(_, peak)| peak > count_limit).map(fault).collect()
    }
}

/// Smaller eigenvalue of the sum of τ τ^T over all entries, with τ the unit flow at the plate's centre.
fn spread_at_center(library: &Library) -> f64 {
    let flows = library.entries.iter().map(|entry| entry.pump.direction_at(Vec2::zeros()));
    let (xx, xy, yy) = flows.fold((0.0, 0.0, 0.0), |(xx, xy, yy), t| (xx + t.x * t.x, xy + t.x * t.y, yy + t.y * t.y));
    0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy)
}

struct Faults(Vec<LibraryFault>);

impl Faults {
    fn add(&mut self, path: impl Into<String>, found: impl std::fmt::Display, allowed: &str) {
        self.0.push(LibraryFault::new(path, found, allowed));
    }

    fn check_head(&mut self, raw: &RawLibrary) {
        if raw.rig.is_empty() {
            self.add("rig", "\"\"", "the name of a rig");
        }
        if !(raw.base_hz.is_finite() && raw.base_hz > 0.0) {
            self.add("base_hz", raw.base_hz, "a positive number");
        }
        self.check_not_negative("attack_s", raw.attack_s);
        self.check_not_negative("rest_s", raw.rest_s);
        for (name, shape) in [("x", raw.shapes.x), ("y", raw.shapes.y), ("spin", raw.shapes.spin)] {
            let flat = shape.as_flattened();
            if flat.iter().any(|v| !v.is_finite()) || flat.iter().all(|&v| v == 0.0) {
                self.add(format!("shapes.{name}"), format!("{shape:?}"), "numbers, not all zero");
            }
        }
    }

    fn check_not_negative(&mut self, path: impl Into<String>, value: f64) {
        if !(value.is_finite() && value >= 0.0) {
            self.add(path, value, "a number not below 0");
        }
    }

    fn check_entries(&mut self, entries: &[RawEntry]) {
        if entries.len() < MIN_ENTRIES {
            self.add("entries", format!("{} entries", entries.len()), "at least 3");
        }
        for (i, entry) in entries.iter().enumerate() {
            let [vx, vy] = entry.velocity_mm_s;
            if !(vx.is_finite() && vy.is_finite() && entry.spin_rad_s.is_finite()) {
                self.add(format!("entries[{i}]"), "a number that is not finite", "finite numbers");
            } else if vx == 0.0 && vy == 0.0 && entry.spin_rad_s == 0.0 {
                self.add(format!("entries[{i}]"), "a plate that does not move", "a velocity or a spin");
            }
        }
    }

    fn check_displacement(&mut self, raw: &RawDisplacement) {
        self.check_rising("displacement.speed_mm_s", &raw.speed_mm_s, "at least 2 rising numbers above 0");
        if raw.speed_mm_s.first().is_some_and(|&slowest| slowest <= 0.0) {
            self.add("displacement.speed_mm_s[0]", raw.speed_mm_s[0], "a number above 0");
        }
        self.check_rising("displacement.sustain_s", &raw.sustain_s, "at least 2 rising numbers not below 0");
        if raw.sustain_s.first().is_some_and(|&shortest| shortest < 0.0) {
            self.add("displacement.sustain_s[0]", raw.sustain_s[0], "a number not below 0");
        }
        for (name, table) in [("distance_mm", &raw.distance_mm), ("sd_mm", &raw.sd_mm)] {
            self.check_table(name, table, raw.speed_mm_s.len(), raw.sustain_s.len());
        }
    }

    fn check_rising(&mut self, path: &str, grid: &[f64], allowed: &str) {
        if grid.len() < 2 {
            self.add(path, format!("{} numbers", grid.len()), allowed);
        }
        for (i, pair) in grid.windows(2).enumerate() {
            let rises = pair[1].is_finite() && pair[1] > pair[0];
            if !rises {
                self.add(format!("{path}[{}]", i + 1), format!("{} after {}", pair[1], pair[0]), allowed);
            }
        }
    }

    fn check_table(&mut self, name: &str, table: &[Vec<f64>], rows: usize, columns: usize) {
        if table.len() != rows {
            self.add(
                format!("displacement.{name}"),
                format!("{} rows", table.len()),
                &format!("{rows}, one for each speed"),
            );
        }
        for (i, row) in table.iter().enumerate() {
            if row.len() != columns {
                let allowed = format!("{columns}, one for each sustain");
                self.add(format!("displacement.{name}[{i}]"), format!("{} numbers", row.len()), &allowed);
            }
            for (k, &value) in row.iter().enumerate() {
                self.check_not_negative(format!("displacement.{name}[{i}][{k}]"), value);
            }
        }
    }
}
