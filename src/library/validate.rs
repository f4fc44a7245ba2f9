use std::f64::consts::TAU;

use super::raw::{
    BASE_HZ, GAIN, MOST_AMPLITUDE, MOST_DISTANCE_MM, MOST_SHAPE, MOST_SPEED_MM_S, MOST_SPIN_RAD_S, MOST_TIME_S,
    PLATE_SIDE_MM, RawDisplacement, RawEntry, RawLibrary,
};
use super::raw_fields::{LIMIT_COUNTS, MOST_RESPONSE, matrix};
use super::raw_plate::{DAMPING_RATIO, NATURAL_HZ};
use super::{FieldResponse, Library, LibraryFault, RawFieldResponse, RawPlateResponse};
use upm_core::geometry::Vec2;
use upm_core::units::mm_from_m;

/// Fewest entries that can steer a part.
const MIN_ENTRIES: usize = 3;

/// Two directions count as two when the flows at the centre spread by more than about 6 degrees.
const MIN_SPREAD: f64 = 0.01;

/// Relative difference between two numbers that are the same.
const SAME: f64 = 1e-6;

/// Largest error of a number rounded to the file's six decimals, mm, Hz or s.
const FILE_ROUNDING: f64 = 0.501e-6;

impl TryFrom<RawLibrary> for Library {
    type Error = Vec<LibraryFault>;

    /// Validates; every fault is listed, with its file still blank.
    fn try_from(raw: RawLibrary) -> Result<Self, Self::Error> {
        let mut faults = Faults(Vec::new());
        faults.check_head(&raw);
        faults.check_entries(&raw.entries);
        faults.check_displacement(&raw.displacement);
        if let Some(fields) = &raw.fields {
            faults.check_fields(fields);
        }
        if let Some(plate) = &raw.plate {
            faults.check_plate(plate);
        }
        let library = raw.into_library();
        if faults.0.is_empty() && spread_at_center(&library) < MIN_SPREAD {
            faults.add("entries", "parts at the centre flow in one direction only", "flows in two directions");
        }
        if faults.0.is_empty() { Ok(library) } else { Err(faults.0) }
    }
}

/// What a library must agree on with the rig it is used on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigFacts<'a> {
    /// Name in its file.
    pub name: &'a str,
    /// Fingerprint of its file.
    pub fingerprint: &'a str,
    /// Base frequency of its drive, rad/s.
    pub base_radps: f64,
    /// Side of its plate, m.
    pub plate_side_m: f64,
    /// Attack of every pulse, s.
    pub attack_s: f64,
    /// Rest after every pulse, s.
    pub rest_s: f64,
    /// Largest sample a motor may be told to play, counts.
    pub count_limit: f64,
    /// Its synthesised motions, if it makes any.
    pub fields: Option<FieldFacts>,
}

/// What a library's response to synthesised motions must agree on with the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldFacts {
    /// Base frequency of the motions, rad/s.
    pub base_radps: f64,
    /// Harmonics of it.
    pub harmonics: usize,
    /// Attack of every pulse, s.
    pub attack_s: f64,
    /// Rest after every pulse, s.
    pub rest_s: f64,
}

impl Library {
    /// Everything that keeps the library from being used on `rig`: distances and centres hold for one rig and its
    /// drive only. A library of a rig of another name is one fault, for all others follow from it.
    pub fn check_fits(&self, rig: &RigFacts<'_>) -> Vec<LibraryFault> {
        if self.rig != rig.name {
            let allowed = format!("{:?}, the rig given", rig.name);
            return vec![LibraryFault::new("rig", format!("{:?}", self.rig), allowed)];
        }
        let mut faults = Vec::new();
        if self.fingerprint != rig.fingerprint {
            let allowed = format!("{:?}: the rig's file has changed, calibrate again", rig.fingerprint);
            faults.push(LibraryFault::new("fingerprint", format!("{:?}", self.fingerprint), allowed));
        }
        faults.extend(differences([
            ("plate_side_mm", mm_from_m(self.plate_side_m), mm_from_m(rig.plate_side_m)),
            ("base_hz", self.base_radps / TAU, rig.base_radps / TAU),
            ("attack_s", self.attack_s, rig.attack_s),
            ("rest_s", self.rest_s, rig.rest_s),
        ]));
        faults.extend(field_faults(self.fields.as_ref(), rig));
        faults.extend(self.unreachable_entries(rig.count_limit));
        faults
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

/// A fault for every number of the library, with its path, that is not the rig's.
fn differences<'a>(numbers: impl IntoIterator<Item = (&'a str, f64, f64)>) -> impl Iterator<Item = LibraryFault> {
    let others = numbers.into_iter().filter(|(_, found, its)| (found - its).abs() > SAME * its.abs() + FILE_ROUNDING);
    let faults: Vec<_> = others
        .map(|(path, found, its)| {
            let [found, its] = [found, its].map(|value| (value * 1e9).round() / 1e9);
            LibraryFault::new(path, found, format!("{its}, as the rig has it"))
        })
        .collect();
    faults.into_iter()
}

fn field_faults(response: Option<&FieldResponse>, rig: &RigFacts<'_>) -> Vec<LibraryFault> {
    let (response, fields) = match (response, &rig.fields) {
        (None, None) => return Vec::new(),
        (Some(response), Some(fields)) => (response, fields),
        (None, Some(_)) => {
            let allowed = "the response to the rig's fields: run `upm calibrate`";
            return vec![LibraryFault::new("fields", "nothing", allowed)];
        }
        (Some(_), None) => {
            let allowed = "nothing: the rig has no fields, calibrate again";
            return vec![LibraryFault::new("fields", "a response", allowed)];
        }
    };
    let measured = response.twist_from_counts.len() as f64;
    differences([
        ("fields.base_hz", response.base_radps / TAU, fields.base_radps / TAU),
        ("fields.attack_s", response.attack_s, fields.attack_s),
        ("fields.rest_s", response.rest_s, fields.rest_s),
        ("fields.limit_counts", response.limit_counts, rig.count_limit),
        ("fields.twist_from_counts", measured, fields.harmonics as f64),
    ])
    .collect()
}

/// Smaller eigenvalue of the sum of τ τ^T over all entries, with τ the unit flow at the plate's centre.
fn spread_at_center(library: &Library) -> f64 {
    let flows = library.entries.iter().map(|entry| entry.pump.direction_at(Vec2::zeros()));
    let (xx, xy, yy) = flows.fold((0.0, 0.0, 0.0), |(xx, xy, yy), t| (xx + t.x * t.x, xy + t.x * t.y, yy + t.y * t.y));
    0.5 * (xx + yy) - (0.5 * (xx - yy)).hypot(xy)
}

/// `1 row`, `2 rows`.
fn counted(number: usize, one: &str, many: &str) -> String {
    format!("{number} {}", if number == 1 { one } else { many })
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
        self.check_within("plate_side_mm", raw.plate_side_mm, PLATE_SIDE_MM);
        self.check_within("base_hz", raw.base_hz, BASE_HZ);
        self.check_within("attack_s", raw.attack_s, (0.0, MOST_TIME_S));
        self.check_within("rest_s", raw.rest_s, (0.0, MOST_TIME_S));
        for (k, &gain) in raw.accelerometer_gain.iter().enumerate() {
            self.check_within(format!("accelerometer_gain[{k}]"), gain, GAIN);
        }
        for (name, shape) in [("x", raw.shapes.x), ("y", raw.shapes.y), ("spin", raw.shapes.spin)] {
            let flat = shape.as_flattened();
            let bounded = flat.iter().all(|v| v.abs() <= MOST_SHAPE);
            if !bounded || flat.iter().all(|&v| v == 0.0) {
                let allowed = format!("numbers from -{MOST_SHAPE} to {MOST_SHAPE}, not all zero");
                self.add(format!("shapes.{name}"), format!("{shape:?}"), &allowed);
            }
        }
    }

    /// A fault unless `value` is a number from the first to the second of `range`.
    fn check_within(&mut self, path: impl Into<String>, value: f64, range: (f64, f64)) {
        let (low, high) = range;
        if !(low..=high).contains(&value) {
            self.add(path, value, &format!("a number from {low} to {high}"));
        }
    }

    fn check_entries(&mut self, entries: &[RawEntry]) {
        if entries.len() < MIN_ENTRIES {
            self.add("entries", counted(entries.len(), "entry", "entries"), "at least 3");
        }
        for (i, entry) in entries.iter().enumerate() {
            self.check_amplitudes(entry.amplitudes, &format!("entries[{i}].amplitudes"));
            let [vx, vy] = entry.velocity_mm_s;
            for (k, v) in [vx, vy].into_iter().enumerate() {
                self.check_within(format!("entries[{i}].velocity_mm_s[{k}]"), v, (-MOST_SPEED_MM_S, MOST_SPEED_MM_S));
            }
            let most = MOST_SPIN_RAD_S;
            self.check_within(format!("entries[{i}].spin_rad_s"), entry.spin_rad_s, (-most, most));
            if vx == 0.0 && vy == 0.0 && entry.spin_rad_s == 0.0 {
                self.add(format!("entries[{i}]"), "a plate that does not move", "a velocity or a spin");
            }
        }
    }

    /// By Eq. 7 four equal amplitudes only squeeze the plate: no net force, no torque.
    fn check_amplitudes(&mut self, amplitudes: [i32; 4], path: &str) {
        let range = -MOST_AMPLITUDE..=MOST_AMPLITUDE;
        for (k, amplitude) in amplitudes.into_iter().enumerate().filter(|(_, amplitude)| !range.contains(amplitude)) {
            let allowed = format!("a whole number from -{MOST_AMPLITUDE} to {MOST_AMPLITUDE}");
            self.add(format!("{path}[{k}]"), amplitude, &allowed);
        }
        if amplitudes.iter().all(|&amplitude| amplitude == amplitudes[0]) {
            self.add(path, format!("{amplitudes:?}"), "four that make a force or a torque, not all the same");
        }
    }

    fn check_displacement(&mut self, raw: &RawDisplacement) {
        let (speeds, sustains) = (&raw.speed_mm_s, &raw.sustain_s);
        self.check_rising("displacement.speed_mm_s", speeds, MOST_SPEED_MM_S, "at least 2 rising numbers above 0");
        if speeds.first().is_some_and(|&slowest| slowest == 0.0) {
            self.add("displacement.speed_mm_s[0]", 0, "a number above 0");
        }
        self.check_rising("displacement.sustain_s", sustains, MOST_TIME_S, "at least 2 rising numbers not below 0");
        for (name, table) in [("distance_mm", &raw.distance_mm), ("sd_mm", &raw.sd_mm)] {
            self.check_table(name, table, speeds.len(), sustains.len());
        }
    }

    fn check_fields(&mut self, raw: &RawFieldResponse) {
        self.check_within("fields.base_hz", raw.base_hz, BASE_HZ);
        self.check_within("fields.attack_s", raw.attack_s, (0.0, MOST_TIME_S));
        self.check_within("fields.rest_s", raw.rest_s, (0.0, MOST_TIME_S));
        self.check_within("fields.limit_counts", raw.limit_counts, LIMIT_COUNTS);
        if raw.twist_from_counts.is_empty() {
            self.add("fields.twist_from_counts", "no harmonic", "one matrix for each harmonic");
        }
        for (k, rows) in raw.twist_from_counts.iter().enumerate() {
            let path = format!("fields.twist_from_counts[{k}]");
            let largest = rows.as_flattened().as_flattened().iter().fold(0.0, |most: f64, part| most.max(part.abs()));
            if largest > MOST_RESPONSE {
                self.add(path, largest, &format!("numbers from -{MOST_RESPONSE} to {MOST_RESPONSE}"));
            } else if matrix(rows).try_inverse().is_none() {
                self.add(path, "a singular matrix", "forces on x, y and spin that move the plate independently");
            }
        }
    }

    fn check_plate(&mut self, raw: &RawPlateResponse) {
        for (key, axes, range) in
            [("natural_hz", raw.natural_hz, NATURAL_HZ), ("damping_ratio", raw.damping_ratio, DAMPING_RATIO)]
        {
            for (axis, value) in [("x", axes.x), ("y", axes.y), ("spin", axes.spin)] {
                self.check_within(format!("plate.{key}.{axis}"), value, range);
            }
        }
    }

    fn check_rising(&mut self, path: &str, grid: &[f64], most: f64, allowed: &str) {
        if grid.len() < 2 {
            self.add(path, counted(grid.len(), "number", "numbers"), allowed);
        }
        for (i, &value) in grid.iter().enumerate() {
            self.check_within(format!("{path}[{i}]"), value, (0.0, most));
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
                counted(table.len(), "row", "rows"),
                &format!("{rows}, one for each speed"),
            );
        }
        for (i, row) in table.iter().enumerate() {
            if row.len() != columns {
                let allowed = format!("{columns}, one for each sustain");
                self.add(format!("displacement.{name}[{i}]"), counted(row.len(), "number", "numbers"), &allowed);
            }
            for (k, &value) in row.iter().enumerate() {
                self.check_within(format!("displacement.{name}[{i}][{k}]"), value, (0.0, MOST_DISTANCE_MM));
            }
        }
    }
}
