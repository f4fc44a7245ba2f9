//! The tables of a run: their columns, and the rows that a line of its journal adds to them.

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Type of the values of a column. The first four have their names in JSON Schema.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    Integer,
    Number,
    Boolean,
    String,
    Single,
    /// Lists of these.
    Integers,
    Numbers,
    Strings,
    Singles,
}

/// Name, with the unit where there is one, type, and JSON pointer to the value in a line. In the pointer `#` is the
/// index of the row; [`NUMBER`] alone is the number of the row, from 1.
#[derive(Debug, Deserialize)]
pub(crate) struct Column(pub String, pub Kind, pub String);

/// A table of a run.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Table {
    /// Stem of the file name.
    pub name: String,
    /// Types of the lines that add rows; `report` for the report.
    pub lines: Vec<String>,
    pub columns: Vec<Column>,
    /// JSON pointers to lists in a line: it adds as many rows as the longest has items; one row without lists.
    lists: Vec<String>,
}

const NUMBER: &str = "#";

/// All tables, in the order in which they are written.
pub(super) static TABLES: LazyLock<Vec<Table>> = LazyLock::new(|| {
    let tables = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/export-tables.json"));
    serde_json::from_str(tables).unwrap_or_default()
});

impl Table {
    /// Rows that `line` adds, one value per column, null where the run has none; the error says what the line lacks.
    pub fn rows(&self, line: &Value) -> Result<Vec<Vec<Value>>, String> {
        let mut count = usize::from(self.lists.is_empty());
        for pointer in &self.lists {
            let list = line.pointer(pointer).and_then(Value::as_array);
            count = count.max(list.ok_or_else(|| format!("no list {pointer}"))?.len());
        }
        let row = |index| self.columns.iter().map(|column| column.value(line, index)).collect();
        (0..count).map(row).collect()
    }
}

impl Column {
    fn value(&self, line: &Value, index: usize) -> Result<Value, String> {
        let Self(_, kind, pointer) = self;
        if pointer == NUMBER {
            return Ok(json!(index + 1));
        }
        let pointer = pointer.replace('#', &index.to_string());
        let value = line.pointer(&pointer).unwrap_or(&Value::Null);
        match (kind, value) {
            // the journal leaves out flags that are not set
            (Kind::Boolean, Value::Null) => Ok(Value::Bool(false)),
            (_, Value::Null)
            | (Kind::Boolean, Value::Bool(_))
            | (Kind::Number | Kind::Single, Value::Number(_))
            | (Kind::String, Value::String(_)) => Ok(value.clone()),
            (Kind::Singles, Value::Array(_)) => Ok(numbers(value).into_iter().map(|number| number as f32).collect()),
            (Kind::Integers | Kind::Numbers | Kind::Strings, Value::Array(_)) => Ok(value.clone()),
            (Kind::Integer, value) if value.as_i64().is_some() => Ok(value.clone()),
            (_, value) => Err(format!("{value} at {pointer}")),
        }
    }
}

/// All numbers in a value, those of lists in lists, too; a flag counts as 0 or 1.
pub(super) fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        Value::Bool(flag) => vec![f64::from(u8::from(*flag))],
        other => other.as_f64().into_iter().collect(),
    }
}

/// A value as text, without quotes.
pub(super) fn text(value: &Value) -> String {
    match value {
        Value::Null => String::new(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read_from_the_asset() {
        let names: Vec<&str> = TABLES.iter().map(|table| table.name.as_str()).collect();
        assert_eq!(names, ["positions", "targets", "pulses", "timings", "events"]);
        assert!(TABLES.iter().all(|table| !table.lines.is_empty() && !table.columns.is_empty()));
    }
}
