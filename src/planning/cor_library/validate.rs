use std::f64::consts::TAU;

use super::types::AXES;
use super::{DisplacementModel, FieldResponse, Library};
use upm_core::document::{Diagnostic, Diagnostics, counted};
use upm_core::geometry::{Twist, Vec2};
use upm_core::rig::RigModel;
use upm_core::units::{mm_from_m, written_mm};

/// Least spread of the flows at the centre: directions more than about 6 degrees apart count as two.
const MIN_SPREAD: f64 = 0.01;

/// Relative difference below which two numbers are equal.
const SAME: f64 = 1e-6;

/// Largest error of a number rounded to the file's six decimals, mm, Hz or s.
const FILE_ROUNDING: f64 = 0.501e-6;

impl Library {
    /// Validates the rules that a schema cannot express; lists every fault of the library in `file`.
    pub(super) fn checked(self, file: &str) -> Result<Self, Vec<Diagnostic>> {
        let mut faults = Diagnostics::of(file);
        for (name, shape) in AXES.iter().zip(&self.shapes) {
            let moves = shape.0.iter().any(|harmonic| harmonic.cos != 0.0 || harmonic.sin != 0.0);
            faults.require(moves, format!("shapes.{name}"), "zeros", "a waveform that moves the plate");
        }
        check_entries(&self, &mut faults);
        check_displacement(&self.displacement, &mut faults);
        for (k, matrix) in self.fields.iter().flat_map(|fields| fields.twist_from_counts.iter().enumerate()) {
            let allowed = "forces on x, y and spin that move the plate independently";
            let path = format!("fields.twist_from_counts[{k}]");
            faults.require(matrix.try_inverse().is_some(), path, "a singular matrix", allowed);
        }
        let at_center = self.entries.iter().map(|entry| entry.pump.direction_at(Vec2::zeros()));
        if faults.is_empty() && flow_eigenvalues(at_center)[1] < MIN_SPREAD {
            faults.push("entries", "parts at the centre flow in one direction only", "flows in two directions");
        }
        faults.into_result(Some(self))
    }

    /// All reasons why the library cannot be used on `rig`, whose file has this fingerprint: distances and centres hold
    /// for one rig and its drive only. Where the fingerprints are equal, so is all that was measured, whatever the rig
    /// is called; otherwise the library of a rig with another name is a single fault, since all others follow from it.
    pub fn check_fits(&self, rig: &RigModel, fingerprint: &str) -> Vec<Diagnostic> {
        let is_same = self.fingerprint == fingerprint;
        if !is_same && self.rig != rig.name {
            let allowed = format!("{:?} (run `upm calibrate` for this rig)", rig.name);
            return vec![Diagnostic::new("", "rig", format!("{:?}", self.rig), allowed)];
        }
        let mut faults = Vec::new();
        if !is_same {
            let allowed = format!("{fingerprint:?} (the rig's file has changed: run `upm calibrate`)");
            faults.push(Diagnostic::new("", "fingerprint", format!("{:?}", self.fingerprint), allowed));
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

    /// Faults for entries that the rig's motors cannot play: their waveforms peak above `count_limit`.
    pub fn unreachable_entries(&self, count_limit: f64) -> Vec<Diagnostic> {
        let peak = |entry: usize| Some((entry, self.drive(entry, 0.0)?.peak_above(count_limit)?));
        let fault = |(entry, peak): (usize, f64)| {
            let allowed = format!("amplitudes whose waveform peaks at {count_limit:.0} counts or less");
            Diagnostic::new("", format!("entries[{entry}].amplitudes"), format!("a peak of {peak:.0} counts"), allowed)
        };
        (0..self.entries.len()).filter_map(peak).map(fault).collect()
    }
}

/// A fault for every number of the library that differs from the rig's, with its path.
fn differences<'a>(numbers: impl IntoIterator<Item = (&'a str, f64, f64)>) -> impl Iterator<Item = Diagnostic> {
    let others = numbers.into_iter().filter(|(_, found, its)| (found - its).abs() > SAME * its.abs() + FILE_ROUNDING);
    others.map(|(path, found, its)| {
        let [found, its] = [found, its].map(|value| (value * 1e9).round() / 1e9);
        Diagnostic::new("", path, found, format!("{its}, as the rig has it"))
    })
}

fn field_faults(response: Option<&FieldResponse>, rig: &RigModel) -> Vec<Diagnostic> {
    let (response, fields) = match (response, &rig.fields) {
        (None, None) => return Vec::new(),
        (Some(response), Some(fields)) => (response, fields),
        (None, Some(_)) => {
            let allowed = "the response to the rig's fields (run `upm calibrate`)";
            return vec![Diagnostic::missing("", "fields", allowed)];
        }
        (Some(_), None) => {
            let allowed = "nothing (the rig has no fields: run `upm calibrate`)";
            return vec![Diagnostic::new("", "fields", "a response", allowed)];
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

/// Eigenvalues of the sum of τ τ^T over all flows τ, the larger first.
pub(crate) fn flow_eigenvalues(flows: impl Iterator<Item = Vec2>) -> [f64; 2] {
    let (xx, xy, yy) = flows.fold((0.0, 0.0, 0.0), |(xx, xy, yy), t| (xx + t.x * t.x, xy + t.x * t.y, yy + t.y * t.y));
    let (middle, spread) = (0.5 * (xx + yy), libm::hypot(0.5 * (xx - yy), xy));
    [middle + spread, middle - spread]
}

fn check_entries(Library { entries, motor_arrangement: arrangement, .. }: &Library, faults: &mut Diagnostics) {
    for (i, entry) in entries.iter().enumerate() {
        // by Eq. 7 four equal amplitudes around the plate only squeeze it: no net force, no torque
        let around = arrangement.turned(entry.amplitudes);
        let moves = around.iter().any(|&amplitude| amplitude != around[0]);
        let allowed = "four that make a force or a torque, not all the same";
        faults.require(moves, format!("entries[{i}].amplitudes"), format!("{:?}", entry.amplitudes), allowed);
        let is_moved = entry.pump != Twist::ZERO;
        faults.require(is_moved, format!("entries[{i}]"), "a plate that does not move", "a velocity or a spin");
    }
}

fn check_displacement(model: &DisplacementModel, faults: &mut Diagnostics) {
    let (speeds, sustains) = (&model.speed_mps, &model.sustain_s);
    let speeds_mm_s: Vec<f64> = speeds.iter().copied().map(written_mm).collect();
    check_rising("displacement.speed_mm_s", &speeds_mm_s, "rising numbers above 0", faults);
    faults.require(speeds.first() != Some(&0.0), "displacement.speed_mm_s[0]", 0, "a number above 0");
    check_rising("displacement.sustain_s", sustains, "rising numbers not below 0", faults);
    for (name, table) in [("distance_mm", &model.distance_m), ("sd_mm", &model.sd_m)] {
        let (rows, columns) = (speeds.len(), sustains.len());
        let path = format!("displacement.{name}");
        let allowed = format!("{rows}, one for each speed");
        faults.require(table.len() == rows, &path, counted(table.len(), "row"), allowed);
        for (i, row) in table.iter().enumerate() {
            let allowed = format!("{columns}, one for each sustain");
            let found = counted(row.len(), "number");
            faults.require(row.len() == columns, format!("{path}[{i}]"), found, allowed);
        }
    }
}

fn check_rising(path: &str, grid: &[f64], allowed: &str, faults: &mut Diagnostics) {
    for (i, pair) in grid.windows(2).enumerate() {
        let found = format!("{} after {}", pair[1], pair[0]);
        faults.require(pair[1] > pair[0], format!("{path}[{}]", i + 1), found, allowed);
    }
}
