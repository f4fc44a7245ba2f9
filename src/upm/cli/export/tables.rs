//! The tables of a run: their columns, and the rows that a line of its journal adds to them.

use serde_json::{Value, json};

/// Type of the values of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Whole,
    Real,
    Flag,
    Text,
}

/// Name, with the unit where there is one, type, and JSON pointer to the value in a line. In the pointer `#` is the
/// index of the row; [`NUMBER`] alone is the number of the row, from 1.
#[derive(Debug)]
pub(super) struct Column(pub &'static str, pub Kind, pub &'static str);

/// A table of a run.
#[derive(Debug)]
pub(super) struct Table {
    /// Stem of the file name.
    pub name: &'static str,
    pub columns: &'static [Column],
    /// JSON pointers to lists in a line: it adds as many rows as the longest has items.
    lists: &'static [&'static str],
}

const NUMBER: &str = "#";

use Kind::{Flag, Real, Text, Whole};

/// Position of each part before and after each cycle, and the position that the plan predicted.
pub(super) const POSITIONS: Table = Table {
    name: "positions",
    lists: &["/observed_mm"],
    columns: &[
        Column("cycle", Whole, "/cycle"),
        Column("part", Whole, NUMBER),
        Column("id", Text, "/parts/#/id"),
        Column("kind", Text, "/parts/#/kind"),
        Column("observed_at_s", Real, "/observed_at_s"),
        Column("observed_x_mm", Real, "/observed_mm/#/0"),
        Column("observed_y_mm", Real, "/observed_mm/#/1"),
        Column("predicted_x_mm", Real, "/predicted_mm/#/0"),
        Column("predicted_y_mm", Real, "/predicted_mm/#/1"),
        Column("ended_at_s", Real, "/ended_at_s"),
        Column("result_x_mm", Real, "/result_mm/#/0"),
        Column("result_y_mm", Real, "/result_mm/#/1"),
    ],
};

/// Target of each part in each cycle.
pub(super) const TARGETS: Table = Table {
    name: "targets",
    lists: &["/wanted/subgoals_mm", "/wanted/targets_mm"],
    columns: &[
        Column("cycle", Whole, "/cycle"),
        Column("at_s", Real, "/observed_at_s"),
        Column("phase", Text, "/wanted/phase"),
        Column("part", Whole, NUMBER),
        Column("id", Text, "/parts/#/id"),
        Column("kind", Text, "/parts/#/kind"),
        Column("subgoal_x_mm", Real, "/wanted/subgoals_mm/#/0"),
        Column("subgoal_y_mm", Real, "/wanted/subgoals_mm/#/1"),
        Column("target_x_mm", Real, "/wanted/targets_mm/#/0"),
        Column("target_y_mm", Real, "/wanted/targets_mm/#/1"),
        Column("cross_track_mm", Real, "/wanted/cross_track_mm/#"),
    ],
};

/// Each pulse as sent, and its measurements by the accelerometers.
pub(super) const PULSES: Table = Table {
    name: "pulses",
    lists: &["/sent"],
    columns: &[
        Column("cycle", Whole, "/cycle"),
        Column("pulse", Whole, NUMBER),
        Column("started_at_s", Real, "/sent/#/started_at_s"),
        Column("probe", Flag, "/sent/#/probe"),
        Column("base_hz", Real, "/sent/#/base_hz"),
        Column("attack_s", Real, "/sent/#/attack_s"),
        Column("sustain_s", Real, "/sent/#/sustain_s"),
        Column("rest_s", Real, "/sent/#/rest_s"),
        Column("read_pump_x_mm_s", Real, "/sent/#/read/pump_mm_s/0"),
        Column("read_pump_y_mm_s", Real, "/sent/#/read/pump_mm_s/1"),
        Column("read_pump_rad_s", Real, "/sent/#/read/pump_rad_s"),
        Column("read_cor_x_mm", Real, "/sent/#/read/cor_mm/0"),
        Column("read_cor_y_mm", Real, "/sent/#/read/cor_mm/1"),
        Column("read_rotation", Whole, "/sent/#/read/rotation"),
        Column("read_direction_x", Real, "/sent/#/read/direction/0"),
        Column("read_direction_y", Real, "/sent/#/read/direction/1"),
        Column("read_residual_m_s2", Real, "/sent/#/read/residual_m_s2"),
        Column("read_off_asked", Real, "/sent/#/read/off_asked"),
        Column("read_fault", Text, "/sent/#/read/fault"),
    ],
};

/// Wall times of the run's steps, from its report.
pub(super) const TIMINGS: Table = Table {
    name: "timings",
    lists: &["/timings"],
    columns: &[
        Column("step", Text, "/timings/#/0"),
        Column("p50_us", Real, "/timings/#/1/p50"),
        Column("p99_us", Real, "/timings/#/1/p99"),
        Column("max_us", Real, "/timings/#/1/max"),
    ],
};

/// All tables, in the order in which they are written.
pub(super) const TABLES: [&Table; 4] = [&POSITIONS, &TARGETS, &PULSES, &TIMINGS];

impl Table {
    /// Rows that `line` adds, one value per column, null where the run has none; the error says what the line lacks.
    pub fn rows(&self, line: &Value) -> Result<Vec<Vec<Value>>, String> {
        let mut count = 0;
        for pointer in self.lists {
            let list = line.pointer(pointer).and_then(Value::as_array);
            count = count.max(list.ok_or_else(|| format!("no list {pointer}"))?.len());
        }
        let row = |index| self.columns.iter().map(|column| column.value(line, index)).collect();
        (0..count).map(row).collect()
    }
}

impl Column {
    fn value(&self, line: &Value, index: usize) -> Result<Value, String> {
        let Self(_, kind, pointer) = *self;
        if pointer == NUMBER {
            return Ok(json!(index + 1));
        }
        let pointer = pointer.replace('#', &index.to_string());
        let value = line.pointer(&pointer).unwrap_or(&Value::Null);
        match (kind, value) {
            // the journal leaves out flags that are not set
            (Flag, Value::Null) => Ok(Value::Bool(false)),
            (_, Value::Null) | (Flag, Value::Bool(_)) | (Real, Value::Number(_)) | (Text, Value::String(_)) => {
                Ok(value.clone())
            }
            (Whole, value) if value.as_i64().is_some() => Ok(value.clone()),
            (_, value) => Err(format!("{value} at {pointer}")),
        }
    }
}
