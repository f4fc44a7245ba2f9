//! The tables of a run: their columns, and the rows made from journal lines or a report.

use super::journal::{ExportCycle, ExportPointMm, Sent};
use super::table::{Column, ExportTable, Kind, TableCell};
use upm_recording::{PartReport, Quantiles, TimingsReport};

use Kind::{Flag, Real, Text, Whole};

/// Position of each part before and after each cycle, and the position that the plan predicted.
pub(super) const POSITIONS: ExportTable = ExportTable {
    name: "positions",
    columns: &[
        Column("cycle", Whole),
        Column("part", Whole),
        Column("id", Text),
        Column("kind", Text),
        Column("observed_at_s", Real),
        Column("observed_x_mm", Real),
        Column("observed_y_mm", Real),
        Column("predicted_x_mm", Real),
        Column("predicted_y_mm", Real),
        Column("ended_at_s", Real),
        Column("result_x_mm", Real),
        Column("result_y_mm", Real),
    ],
};

/// Target of each part in each cycle.
pub(super) const TARGETS: ExportTable = ExportTable {
    name: "targets",
    columns: &[
        Column("cycle", Whole),
        Column("at_s", Real),
        Column("phase", Text),
        Column("part", Whole),
        Column("id", Text),
        Column("kind", Text),
        Column("subgoal_x_mm", Real),
        Column("subgoal_y_mm", Real),
        Column("target_x_mm", Real),
        Column("target_y_mm", Real),
        Column("cross_track_mm", Real),
    ],
};

/// Each pulse as sent, and its measurements by the accelerometers.
pub(super) const PULSES: ExportTable = ExportTable {
    name: "pulses",
    columns: &[
        Column("cycle", Whole),
        Column("pulse", Whole),
        Column("started_at_s", Real),
        Column("probe", Flag),
        Column("base_hz", Real),
        Column("attack_s", Real),
        Column("sustain_s", Real),
        Column("rest_s", Real),
        Column("read_pump_x_mm_s", Real),
        Column("read_pump_y_mm_s", Real),
        Column("read_pump_rad_s", Real),
        Column("read_cor_x_mm", Real),
        Column("read_cor_y_mm", Real),
        Column("read_rotation", Whole),
        Column("read_direction_x", Real),
        Column("read_direction_y", Real),
        Column("read_residual_m_s2", Real),
        Column("read_off_asked", Real),
        Column("read_fault", Text),
    ],
};

/// Wall times of the run's steps, from its report.
pub(super) const TIMINGS: ExportTable = ExportTable {
    name: "timings",
    columns: &[Column("step", Text), Column("p50_us", Real), Column("p99_us", Real), Column("max_us", Real)],
};

/// All tables, in the order in which they are written.
pub(super) const TABLES: [&ExportTable; 4] = [&POSITIONS, &TARGETS, &PULSES, &TIMINGS];

/// Parts by their number in the journal; empty for a run without a report.
pub(super) struct PartNames<'a>(pub &'a [PartReport]);

impl PartNames<'_> {
    /// Number from 1, id and kind.
    fn cells(&self, index: usize) -> [TableCell<'_>; 3] {
        let part = self.0.get(index);
        let text = |of: fn(&PartReport) -> &String| part.map_or(TableCell::Empty, |part| TableCell::Text(of(part)));
        [whole(index as u64 + 1), text(|part| &part.id), text(|part| &part.kind)]
    }
}

/// Rows of [`POSITIONS`].
pub(super) fn positions<'a>(
    cycle: &'a ExportCycle,
    parts: &'a PartNames<'a>,
) -> impl Iterator<Item = Vec<TableCell<'a>>> {
    (0..cycle.observed_mm.len()).map(move |index| {
        let predicted_mm = cycle.predicted_mm.as_deref().unwrap_or_default();
        let mut row = vec![whole(cycle.cycle)];
        row.extend(parts.cells(index));
        row.push(TableCell::Real(cycle.observed_at_s));
        row.extend(point(cycle.observed_mm.get(index)));
        row.extend(point(predicted_mm.get(index)));
        row.push(TableCell::Real(cycle.ended_at_s));
        row.extend(point(cycle.result_mm.get(index)));
        row
    })
}

/// Rows of [`TARGETS`].
pub(super) fn targets<'a>(
    cycle: &'a ExportCycle,
    parts: &'a PartNames<'a>,
) -> impl Iterator<Item = Vec<TableCell<'a>>> {
    let wanted = &cycle.wanted;
    let count = wanted.subgoals_mm.len().max(wanted.targets_mm.len());
    (0..count).map(move |index| {
        let mut row = vec![whole(cycle.cycle), TableCell::Real(cycle.observed_at_s), TableCell::Text(&wanted.phase)];
        row.extend(parts.cells(index));
        row.extend(point(wanted.subgoals_mm.get(index)));
        row.extend(point(wanted.targets_mm.get(index)));
        row.push(real(wanted.cross_track_mm.get(index).copied().flatten()));
        row
    })
}

/// Rows of [`PULSES`], the pulses of one cycle.
pub(super) fn pulses(cycle: u64, sent: &[Sent]) -> impl Iterator<Item = Vec<TableCell<'_>>> {
    sent.iter().zip(1..).map(move |(pulse, number)| {
        let read = &pulse.read;
        let mut row = vec![
            whole(cycle),
            whole(number),
            TableCell::Real(pulse.started_at_s),
            TableCell::Flag(pulse.probe),
            TableCell::Real(pulse.base_hz),
            TableCell::Real(pulse.attack_s),
            TableCell::Real(pulse.sustain_s),
            TableCell::Real(pulse.rest_s),
        ];
        row.extend(point(read.pump_mm_s.as_ref()));
        row.push(real(read.pump_rad_s));
        row.extend(point(read.cor_mm.as_ref()));
        row.push(read.rotation.map_or(TableCell::Empty, TableCell::Whole));
        row.extend(point(read.direction.as_ref()));
        row.extend([real(read.residual_m_s2), real(read.off_asked)]);
        row.push(read.fault.as_deref().map_or(TableCell::Empty, TableCell::Text));
        row
    })
}

/// Rows of [`TIMINGS`].
pub(super) fn timings(report: &TimingsReport) -> impl Iterator<Item = Vec<TableCell<'static>>> + use<> {
    let TimingsReport { localise, track, plan, plan_new, plan_correction, cycle } = *report;
    let steps = [
        ("localise", localise),
        ("track", track),
        ("plan", plan),
        ("plan_new", plan_new),
        ("plan_correction", plan_correction),
        ("cycle", cycle),
    ];
    steps.into_iter().map(|(step, Quantiles { p50, p99, max })| {
        vec![TableCell::Text(step), TableCell::Real(p50), TableCell::Real(p99), TableCell::Real(max)]
    })
}

fn whole(number: u64) -> TableCell<'static> {
    i64::try_from(number).map_or(TableCell::Empty, TableCell::Whole)
}

fn real(number: Option<f64>) -> TableCell<'static> {
    number.map_or(TableCell::Empty, TableCell::Real)
}

fn point(point: Option<&ExportPointMm>) -> [TableCell<'static>; 2] {
    point.copied().unwrap_or([None; 2]).map(real)
}
