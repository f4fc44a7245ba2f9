use std::fs::File;
use std::io::{self, BufWriter, Write};

use serde_json::json;

use super::{Bench, RunError, RunFolder};
use upm_control::{FrameFacts, Sink};
use upm_core::ground_truth::GroundTruthHandle;
use upm_core::units::mm_from_m;

/// Name of the file.
pub(super) const FILE: &str = "truth.jsonl";

/// Writes where the parts truly are, a line a frame, into the folder of a run with faults: what those are judged by who
/// share no code with the run. `{"at_s", "parts": [[x_mm, y_mm, 1 while on the plate]]}`, in the order of the report.
#[derive(Debug, Default)]
pub(super) struct TruthLog {
    to: Option<(GroundTruthHandle, BufWriter<File>)>,
    broken: Option<io::Error>,
}

impl TruthLog {
    /// For `bench`, which has faults or has none.
    pub(super) fn of(bench: &Bench, folder: &RunFolder) -> Result<Self, RunError> {
        if bench.faults.is_empty() {
            return Ok(Self::default());
        }
        let file = File::create(folder.path().join(FILE)).map_err(|error| folder.write_error(FILE, &error))?;
        Ok(Self { to: Some((bench.truth(), BufWriter::new(file))), broken: None })
    }

    /// Everything is in the file, or the first thing that went wrong.
    pub(super) fn finish(self) -> io::Result<()> {
        self.broken.map_or(Ok(()), Err)?;
        self.to.map_or(Ok(()), |(_, mut file)| file.flush())
    }
}

impl Sink for TruthLog {
    fn frame(&mut self, _: &FrameFacts<'_>) {
        let Some((truth, file)) = self.to.as_mut().filter(|_| self.broken.is_none()) else { return };
        let truth = truth.read();
        let rounded = |m: f64| (mm_from_m(m) * 1e4).round() * 1e-4;
        let place = |part: &upm_core::ground_truth::PartTruth| {
            let p_m = part.part_in_table.position_m;
            json!([rounded(p_m.x), rounded(p_m.y), u8::from(part.on_plate)])
        };
        let line = json!({ "at_s": truth.at.secs(), "parts": truth.parts.iter().map(place).collect::<Vec<_>>() });
        self.broken = writeln!(file, "{line}").err();
    }
}
