//! Reports of table and parts found in a picture, for programs and for people.

use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};

use super::setting::Setting;
use crate::cli::output::Failure;
use upm_core::units::mm_from_m;
use upm_perception::vision::ResponseMethod;
use upm_recording::LocalisedRecord;

/// Table and parts found in a picture.
pub(super) struct Located {
    pub found: LocalisedRecord,
    pub method: Method,
    pub time_us: TimeUs,
}

/// How a picture was searched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Method {
    /// The program's own vision, with the method of the disks' response.
    Fast(ResponseMethod),
    /// Standard algorithms of `imageproc`.
    #[cfg(feature = "lab")]
    Reference,
}

/// Wall time that one picture took, µs.
#[derive(Clone, Copy, Debug)]
pub(super) struct TimeUs {
    /// Reading and decoding the file.
    pub decode: f64,
    pub table: f64,
    /// Finding the parts, everything that is made for it included.
    pub parts: f64,
    /// Finding both.
    pub localise: f64,
}

impl TimeUs {
    /// Of decoding, and of the instants before the table, between the two and after the parts.
    pub fn of(decode: Duration, [begun, found, done]: [Duration; 3]) -> Self {
        let us = |time: Duration| 1e6 * time.as_secs_f64();
        Self { decode: us(decode), table: us(found - begun), parts: us(done - found), localise: us(done - begun) }
    }
}

pub(super) fn as_json(located: &Located, setting: &Setting) -> Value {
    let Located { found: LocalisedRecord { table, detections: parts, .. }, method, time_us } = located;
    let parts = parts.iter().map(|part| {
        let [[xx, xy], [_, yy]] = part.covariance_px2.into();
        json!({
            "kind": setting.kind_name(part.kind),
            "center_px": [part.center_px.x, part.center_px.y],
            "radius_px": part.radius_px,
            "position_mm": [mm_from_m(part.position_m.x), mm_from_m(part.position_m.y)],
            "score": part.score,
            "covariance_px2": [[xx, xy], [xy, yy]],
        })
    });
    let (method, response) = named(*method);
    json!({
        "method": method,
        "response": response,
        "table": {
            "corners_px": table.corners_px.map(|corner| [corner.x, corner.y]),
            "side_px": table.side_px,
            "rotation_deg": table.rotation_rad.to_degrees(),
        },
        "parts": parts.collect::<Vec<_>>(),
        "time_us": { "decode": time_us.decode, "table": time_us.table, "parts": time_us.parts },
    })
}

/// Search method, and method of the disks' response.
fn named(method: Method) -> (&'static str, &'static str) {
    match method {
        Method::Fast(ResponseMethod::Fft) => ("fast", "fft"),
        Method::Fast(_) => ("fast", "chords"),
        #[cfg(feature = "lab")]
        Method::Reference => ("reference", "template"),
    }
}

/// `value` as one line that begins with the picture's name.
pub(super) fn say_line(image: &Path, value: Value) -> Result<(), Failure> {
    let mut line = serde_json::Map::from_iter([("image".to_owned(), json!(image.display().to_string()))]);
    if let Value::Object(found) = value {
        line.extend(found);
    }
    say!("{}", Value::Object(line))
}

pub(super) fn say_located(located: &Located, setting: &Setting) -> Result<(), Failure> {
    let Located { found: LocalisedRecord { table, detections: parts, .. }, method, time_us } = located;
    if let ("reference", _) = named(*method) {
        say!("method: reference (Canny, Hough and template matching of imageproc)")?;
    }
    say!("table: side {:.1} px, turned {:.2} deg", table.side_px, table.rotation_rad.to_degrees())?;
    for (name, corner) in ["top left", "top right", "bottom right", "bottom left"].iter().zip(table.corners_px) {
        say!("  {name:12} ({:8.2}, {:8.2}) px", corner.x, corner.y)?;
    }
    say!("parts: {}", parts.len())?;
    for part in parts {
        let (name, at) = (setting.kind_name(part.kind), part.position_m * 1e3);
        let (radius, score) = (part.radius_px, part.score);
        say!("  {name:12} ({:8.2}, {:8.2}) mm   radius {radius:.2} px   score {score:.3}", at.x, at.y)?;
    }
    let TimeUs { decode, table, parts, .. } = *time_us;
    let [decode, table, parts] = [decode, table, parts].map(|us| us / 1e3);
    say!(
        "found: {} in {:.1} ms (table {table:.1}, parts {parts:.1}); decoded in {decode:.1} ms",
        counted(located, setting),
        table + parts
    )
}

/// `a table, 3 penny, 1 dime`; every kind that was looked for.
fn counted(located: &Located, setting: &Setting) -> String {
    let count = |i| located.found.detections.iter().filter(|part| part.kind == i).count();
    let counts = setting.kinds.iter().enumerate().map(|(i, kind)| format!(", {} {}", count(i), kind.name));
    format!("a table{}", counts.collect::<String>())
}
