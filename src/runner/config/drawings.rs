//! Replaces the drawing files that a job names by their path data.

use super::job_file::{JobFile, TaskSection};
use super::read::{Origin, exactly_one};
use super::shape_file::SvgShape;
use upm_core::document::{Diagnostic, Diagnostics, Path, text_of};
use upm_planning::shapes::path_data_of;

/// Longest path data accepted in a job, bytes.
const LONGEST_DATA: usize = 65_536;

impl JobFile {
    /// The same job with path data in place of its drawing files.
    ///
    /// # Errors
    /// Every file that cannot be read or contains no path.
    pub fn with_drawings_written_out(mut self, origin: &Origin) -> Result<Self, Vec<Diagnostic>> {
        let mut faults = Diagnostics::of(&origin.file);
        write_out(&mut self.task, origin, &mut faults);
        faults.into_result(Some(self))
    }
}

/// Writes path data in place of every file that the task names.
pub(super) fn write_out(task: &mut TaskSection, origin: &Origin, faults: &mut Diagnostics) {
    let at = Path::root().key("task");
    match task {
        TaskSection::Arrange { targets: Some(targets), .. } => {
            let at = at.key("targets").key("svg");
            targets.svg.iter_mut().for_each(|svg| write_out_one(svg, &at, origin, faults));
        }
        TaskSection::Trajectories { paths, .. } => {
            for (i, path) in paths.iter_mut().enumerate() {
                let at = at.key("paths").index(i).key("svg");
                path.svg.iter_mut().for_each(|svg| write_out_one(svg, &at, origin, faults));
            }
        }
        TaskSection::PlusSign { .. }
        | TaskSection::Arrange { .. }
        | TaskSection::Sort { .. }
        | TaskSection::Hold { .. } => {}
    }
}

fn write_out_one(svg: &mut SvgShape, at: &Path, origin: &Origin, faults: &mut Diagnostics) {
    if !exactly_one(svg, &["file", "d"], at, faults) {
        svg.d = None;
        return;
    }
    let Some(named) = svg.file.take() else { return };
    let at = at.key("file");
    let Some(path) = origin.named_file(&named, &at, faults) else { return };
    match text_of(&path) {
        Err(unread) => faults.append(unread),
        Ok(text) => match path_data_of(&text) {
            Err(found) => faults.push(&at, format!("{} with {found}", path.display()), "an SVG drawing with paths"),
            Ok(d) if d.len() > LONGEST_DATA => {
                let found = format!("{} with path data of {} bytes", path.display(), d.len());
                faults.push(&at, found, format!("up to {LONGEST_DATA} bytes: a simpler drawing"));
            }
            Ok(d) => svg.d = Some(d),
        },
    }
}
